"""Light and smoothing of pictures, as programs for OpenGL 4.0.

Vectors are in the world frame, lengths in m. BODIES stands for the number of bodies. A software
OpenGL skips no branches, but loops that are over before they begin, and pixels that are discarded:
so a branch that costs much is written as one of these. What is linear over a triangle is worked out
at its corners, of which there are far fewer than pixels.
"""

from __future__ import annotations

_VERTEX = """\
#version 330
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec4 colour;
layout(location = 3) in float body;
uniform mat4 view;
uniform vec4 pose[3 * BODIES];  // rows of rotation and place of each body
#ifdef PICTURE
flat out vec4 paint;
#ifdef LAMP
out vec3 facing;
out vec3 at;
#endif
#ifdef SUN
uniform vec3 towards;  // to the sun
uniform vec3 back;  // to the viewer
uniform vec3 up;
out vec3 slope;  // of the surface to each of these, the cosine
uniform mat4 near_view;  // from the sun to the robot, and to all pipes
uniform mat4 far_view;
out vec3 near_place;
out vec3 far_place;
#endif
#endif

void main() {
  int row = 3 * int(body);
  vec4 local = vec4(position, 1.0);
  vec3 world = vec3(dot(pose[row], local), dot(pose[row + 1], local), dot(pose[row + 2], local));
  gl_Position = view * vec4(world, 1.0);
#ifdef PICTURE
  vec3 outward = vec3(dot(pose[row].xyz, normal), dot(pose[row + 1].xyz, normal),
                      dot(pose[row + 2].xyz, normal));
  paint = colour;
#ifdef LAMP
  facing = outward;
  at = world;
#endif
#ifdef SUN
  slope = vec3(dot(outward, towards), dot(outward, back), dot(outward, up));
  vec4 raised = vec4(world + 0.0012 * outward, 1.0);
  near_place = (near_view * raised).xyz;
  far_place = (far_view * raised).xyz;
#endif
#endif
}
"""

_SUN = """\
#version 330
in vec3 slope;
flat in vec4 paint;
in vec3 near_place;
in vec3 far_place;
out vec4 shown;
uniform float clearness;
uniform sampler2DShadow near_map;
uniform sampler2DShadow far_map;

float light_through(sampler2DShadow map, vec3 place, float light) {
  bool inside = all(greaterThan(place, vec3(0.0))) && all(lessThan(place, vec3(1.0)));
  for (int once = inside && light > 0.0 ? 0 : 1; once < 1; once++) light = texture(map, place);
  return light;
}

void main() {
  float lit = light_through(near_map, near_place, slope.x > 0.0 ? 1.0 : 0.0);
#ifdef STILL
  lit = light_through(far_map, far_place, lit);
#endif
  vec3 light = vec3(0.32, 0.33, 0.35) + slope.z * vec3(0.07, 0.09, 0.11)
             + 0.20 * max(slope.y, 0.0) + max(slope.x, 0.0) * lit * vec3(0.58, 0.555, 0.51);
  vec3 colour = paint.rgb * light;
#ifdef GLOSSY
  float shine = max((slope.x + slope.y) * 0.54, 0.0);  // two unit vectors nearly in line
  shine *= shine; shine *= shine; shine *= shine; shine *= shine;  // to the power of 16
  colour += 0.6 * paint.a * lit * min(shine, 1.0);
#endif
  shown = vec4(colour, clearness);
}
"""

_LAMP = """\
#version 330
in vec3 at;
in vec3 facing;
flat in vec4 paint;
out vec4 shown;
uniform vec3 eye;
uniform vec3 ahead;

float grain(vec3 cell) {  // a random number for each cell
  vec3 q = fract(cell * vec3(0.1031, 0.1030, 0.0973));
  q += dot(q, q.yzx + 33.33);
  return fract((q.x + q.y) * q.z);
}

float noise(vec3 p) {
  vec3 cell = floor(p), f = fract(p);
  f = f * f * (3.0 - 2.0 * f);
  vec2 o = vec2(0.0, 1.0);
  vec4 front = vec4(grain(cell), grain(cell + o.yxx), grain(cell + o.xyx), grain(cell + o.yyx));
  vec4 rear = vec4(grain(cell + o.xxy), grain(cell + o.yxy), grain(cell + o.xyy),
                   grain(cell + o.yyy));
  vec4 sheet = mix(front, rear, f.z);
  vec2 line = mix(sheet.xz, sheet.yw, f.x);
  return mix(line.x, line.y, f.y);
}

void main() {
  vec3 n = normalize(facing);
  vec3 ray = at - eye;
  float reach = length(ray);
  ray /= reach;
  float cone = smoothstep(0.2, 0.95, dot(ray, ahead));
  float falloff = 1.0 / (1.0 + 3.0 * reach + 22.0 * reach * reach);
  float meets = max(-dot(n, ray), 0.0);
  float rough = 0.84 + 0.20 * noise(110.0 * at) + 0.12 * noise(450.0 * at);
  vec3 light = falloff * (vec3(0.05, 0.06, 0.075)
             + vec3(5.0, 4.7, 4.15) * cone * (0.12 + 0.88 * meets));
  shown = vec4(1.0 - exp(-paint.rgb * rough * light), 1.0);
}
"""

_NOTHING = """\
#version 330
void main() {}
"""

_SCREEN = """\
#version 330
void main() {
  vec2 corner = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);
  gl_Position = vec4(corner, 1.0, 1.0);
}
"""

# After T. Lottes, FXAA 3.11 (NVIDIA, 2011): edges are found by the contrast of green, followed to
# both ends for up to REACH pixels, and shifted by the part of a pixel that their ends ask for.
_SMOOTH = """\
#version 400
uniform sampler2D drawn;
uniform vec2 pixel;
out vec4 shown;
const float STEPS[4] = float[4](1.0, 1.5, 2.5, 5.0);

float green(vec2 place) { return textureLod(drawn, place, 0.0).g; }

void main() {
  vec2 place = gl_FragCoord.xy * pixel;
  vec4 one = textureGather(drawn, place - 0.5 * pixel, 1);
  vec4 two = textureGather(drawn, place + 0.5 * pixel, 1);
  float m = one.y, n = one.z, w = one.x, e = two.z, s = two.x;
  float most = max(m, max(max(n, s), max(e, w)));
  float range = most - min(m, min(min(n, s), min(e, w)));
  if (range < max(LEAST_CONTRAST, 0.12 * most)) discard;
  float nw = one.w, se = two.y;
  float ne = green(place + vec2(pixel.x, -pixel.y)), sw = green(place + vec2(-pixel.x, pixel.y));
  float level = abs(nw + sw - 2.0 * w) + 2.0 * abs(n + s - 2.0 * m) + abs(ne + se - 2.0 * e);
  float upright = abs(nw + ne - 2.0 * n) + 2.0 * abs(w + e - 2.0 * m) + abs(sw + se - 2.0 * s);
  bool flat_edge = level >= upright;
  float before = flat_edge ? n : w, after = flat_edge ? s : e;
  bool back = abs(before - m) >= abs(after - m);
  float contrast = 0.25 * max(abs(before - m), abs(after - m));
  float middle = 0.5 * (m + (back ? before : after));
  vec2 across = (flat_edge ? vec2(0.0, pixel.y) : vec2(pixel.x, 0.0)) * (back ? -1.0 : 1.0);
  vec2 along = flat_edge ? vec2(pixel.x, 0.0) : vec2(0.0, pixel.y);
  vec2 ends = vec2(0.0), found = vec2(0.0);
  for (int i = 0; i < 4 && any(lessThan(abs(found), vec2(contrast))); i++) {
    if (abs(found.x) < contrast) {
      ends.x += STEPS[i];
      found.x = green(place + 0.5 * across - ends.x * along) - middle;
    }
    if (abs(found.y) < contrast) {
      ends.y += STEPS[i];
      found.y = green(place + 0.5 * across + ends.y * along) - middle;
    }
  }
  float nearer = ends.x < ends.y ? found.x : found.y;
  float shift = (nearer < 0.0) != (m < middle) ? 0.5 - min(ends.x, ends.y) / (ends.x + ends.y)
                                               : 0.0;
  float mean = (2.0 * (n + s + e + w) + nw + ne + sw + se) / 12.0;
  float speck = clamp(abs(mean - m) / range, 0.0, 1.0);
  speck = speck * speck * (3.0 - 2.0 * speck);
  place += max(shift, 0.6 * speck * speck) * across;
  shown = textureLod(drawn, place, 0.0);
}
"""
REACH = 16
"""Distance at which the smoothing still looks for the end of an edge, pixels."""

_EDGES = """\
#version 400
uniform sampler2D drawn;
uniform vec2 pixel;  // of what was drawn
out float contrast;

void main() {
  vec2 first = BLOCK * floor(gl_FragCoord.xy);
  vec4 low = vec4(1.0), high = vec4(0.0);
  for (float y = 0.0; y <= BLOCK; y += 2.0)
    for (float x = 0.0; x <= BLOCK; x += 2.0) {
      vec4 four = textureGather(drawn, (first + vec2(x, y)) * pixel, 1);
      low = min(low, four);
      high = max(high, four);
    }
  vec2 ends = vec2(min(min(low.x, low.y), min(low.z, low.w)),
                   max(max(high.x, high.y), max(high.z, high.w)));
  contrast = ends.y - ends.x;
}
"""

_BLOCKS = """\
#version 400
layout(location = 0) in vec2 block;
uniform vec2 pixel;
void main() { gl_Position = vec4(2.0 * BLOCK * (block + 0.5) * pixel - 1.0, 0.0, 1.0); }
"""

_REDUCE = """\
#version 330
uniform sampler2D drawn;
uniform vec2 pixel;
out vec4 shown;
void main() { shown = textureLod(drawn, gl_FragCoord.xy * pixel, 0.0); }
"""


def sun(bodies: int, still: bool, glossy: bool) -> tuple[str, str]:
    """Programs of vertices and pixels in the light of a sun; ``still``: pipes throw shadows."""
    words = [word for word, wanted in (("STILL", still), ("GLOSSY", glossy)) if wanted]
    return _vertex(bodies, "PICTURE", "SUN"), _defined(_SUN, *words)


def lamp(bodies: int) -> tuple[str, str]:
    """Programs of vertices and pixels in the light of a lamp at the eye."""
    return _vertex(bodies, "PICTURE", "LAMP"), _LAMP


def depth(bodies: int) -> tuple[str, str]:
    """Programs that leave depths only."""
    return _vertex(bodies), _NOTHING


BLOCK = 4
"""Width of the blocks in which edges are looked for, pixels."""
LEAST_CONTRAST = 0.06
"""Of green, from 0 to 1, from which on there is an edge."""
EDGES = (_SCREEN, _EDGES.replace("BLOCK", f"{BLOCK}.0"))
"""Programs that find the contrast within each block of pixels and those around it."""
SMOOTH = (
    _BLOCKS.replace("BLOCK", f"{BLOCK}.0"),
    _SMOOTH.replace("LEAST_CONTRAST", str(LEAST_CONTRAST)),
)
"""Programs that smooth the stairs of edges in blocks of pixels."""
REDUCE = (_SCREEN, _REDUCE)
"""Programs that take the mean of each two by two pixels."""


def _vertex(bodies: int, *words: str) -> str:
    return _defined(_VERTEX.replace("BODIES", str(bodies)), *words)


def _defined(source: str, *words: str) -> str:
    first, rest = source.split("\n", 1)
    return "\n".join([first, *(f"#define {word}" for word in words), rest])

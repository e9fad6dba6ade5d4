#version 400
// After T. Lottes, FXAA 3.11 (NVIDIA, 2011): edges are found by the contrast of green, followed to
// both ends for up to 10 pixels, and shifted by the part of a pixel that their ends ask for.
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
  if (range < max(MIN_CONTRAST, 0.12 * most)) discard;
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

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
  float falloff = 1.0 / (1.5 + 3.0 * reach + 22.0 * reach * reach);
  float meets = max(-dot(n, ray), 0.0);
  float rough = 0.92 + 0.08 * noise(110.0 * at) + 0.08 * noise(450.0 * at);
  vec3 light = falloff * (vec3(0.05, 0.06, 0.075)
             + vec3(5.3, 5.0, 4.4) * cone * (0.12 + 0.88 * meets));
  shown = vec4(1.0 - exp(-paint.rgb * rough * light), 1.0);
}

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

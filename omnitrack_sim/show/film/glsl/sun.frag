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

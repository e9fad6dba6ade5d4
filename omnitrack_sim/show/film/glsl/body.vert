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

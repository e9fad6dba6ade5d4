#version 400
layout(location = 0) in vec2 block;
uniform vec2 pixel;
void main() { gl_Position = vec4(2.0 * BLOCK * (block + 0.5) * pixel - 1.0, 0.0, 1.0); }

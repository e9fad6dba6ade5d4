#version 330
uniform sampler2D drawn;
uniform vec2 pixel;
out vec4 shown;
void main() { shown = textureLod(drawn, gl_FragCoord.xy * pixel, 0.0); }

uniform float extent;
uniform float radius;
in vec2 corner;
out vec3 normal;
out vec2 place;
void main() {
  place = vec2(0.0);
  // The third component is found at every pixel.
  normal = vec3(corner * extent / radius, 0.0);
  gl_Position = vec4(corner, 0.0, 1.0);
}

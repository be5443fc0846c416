uniform mat3 view_from_world;
uniform vec3 center;
uniform float extent;
uniform float depth;
in vec3 position;
in vec3 direction;
in vec2 coordinate;
out vec3 normal;
out vec2 place;
void main() {
  place = coordinate;
  normal = view_from_world * direction;
  vec3 seen = view_from_world * (position - center);
  gl_Position = vec4(seen.xy / extent, -seen.z / depth, 1.0);
}

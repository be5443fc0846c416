// The reflection map of a distant viewer: what each normal sends to him, base and lobe apart.
// The disc holds normals by their angle to the view, a little beyond the rim.
uniform highp sampler2D cell_directions;
uniform highp sampler2D cell_irradiances;
uniform highp sampler2D directions;
uniform highp sampler2D irradiances;
uniform int cells;
uniform bool exact;
uniform float reach;
uniform float layer;
in vec2 at;
layout(location = 0) out vec4 base_map;
layout(location = 1) out vec4 lobe_map;

// A cell reaches so far from its middle, radians.
const float CELL = 0.16;

vec3 base_sum, lobe_sum;

void add(vec3 normal, vec4 node, vec3 irradiance) {
  float incoming = dot(normal, node.xyz);
  if (incoming <= 0.0) return;
  vec3 lobe;
  float base;
  reflected(incoming, normal.z, node.w, layer, lobe, base);
  base_sum += base * irradiance;
  lobe_sum += lobe * irradiance;
}

void main() {
  float angle = length(at) * reach;
  if (angle > 1.06 * reach) discard;
  vec2 across = length(at) > 0.0 ? at / length(at) : vec2(0.0);
  vec3 normal = vec3(sin(angle) * across, cos(angle));
  base_sum = lobe_sum = vec3(0.0);
  for (int k = 0; k < cells; ++k) {
    ivec2 place = ivec2(k & 255, k >> 8);
    // A direction in the axes of the view, and its cosine to the half vector.
    vec4 node = texelFetch(cell_directions, place, 0);
    float incoming = dot(normal, node.xyz);
    if (incoming <= -CELL) continue;
    vec4 irradiance = texelFetch(cell_irradiances, place, 0);
    float half_cosine = (incoming + normal.z) / (2.0 * node.w);
    float near = 3.0 * width_of(layer) + 0.5 * CELL / node.w;
    if (!exact || (incoming > CELL && half_cosine < cos(min(near, 1.57)))) {
      add(normal, node, irradiance.rgb);
      continue;
    }
    int next = k + 1;
    int last = int(texelFetch(cell_irradiances, ivec2(next & 255, next >> 8), 0).a);
    for (int own = int(irradiance.a); own < last; ++own) {
      ivec2 where = ivec2(own & 255, own >> 8);
      add(normal, texelFetch(directions, where, 0), texelFetch(irradiances, where, 0).rgb);
    }
  }
  base_map = vec4(base_sum, 1.0);
  lobe_map = vec4(lobe_sum, 1.0);
}

// The object as a distant viewer sees it: the map at its normals, and sources by themselves.
const int MOST_SOURCES = 9;
uniform highp sampler2D base_map;
uniform highp sampler2D lobe_map;
uniform float reach;
uniform bool smooth_map;
uniform bool is_sphere;
uniform bool linear_output;
uniform vec3 base_amount;
uniform vec3 lobe_amount;
uniform float exposure;
uniform int sources;
uniform vec4 source_directions[MOST_SOURCES];
uniform vec3 source_irradiances[MOST_SOURCES];
in vec3 normal;
layout(location = 0) out vec4 colour;

// Catmull and Rom's curve through four texels.
vec4 weights_of(float t) {
  return vec4(
    t * (-0.5 + t * (1.0 - 0.5 * t)), 1.0 + t * t * (-2.5 + 1.5 * t),
    t * (0.5 + t * (2.0 - 1.5 * t)), t * t * (-0.5 + 0.5 * t));
}

void look_up(vec2 at, out vec3 base, out vec3 lobe) {
  vec2 size = vec2(textureSize(base_map, 0));
  vec2 place = 0.5 + 0.5 * at;
  if (!smooth_map) {
    base = texture(base_map, place).rgb;
    lobe = texture(lobe_map, place).rgb;
    return;
  }
  vec2 texel = place * size - 0.5;
  vec2 first = floor(texel);
  vec4 wx = weights_of(texel.x - first.x), wy = weights_of(texel.y - first.y);
  ivec2 corner = ivec2(first) - 1, last = ivec2(size) - 1;
  base = vec3(0.0);
  lobe = vec3(0.0);
  for (int row = 0; row < 4; ++row)
    for (int column = 0; column < 4; ++column) {
      ivec2 at_texel = clamp(corner + ivec2(column, row), ivec2(0), last);
      float weight = wx[column] * wy[row];
      base += weight * texelFetch(base_map, at_texel, 0).rgb;
      lobe += weight * texelFetch(lobe_map, at_texel, 0).rgb;
    }
}

vec3 encoded(vec3 radiance) {
  vec3 shown = clamp(radiance, 0.0, 1.0);
  vec3 curve = 1.055 * pow(shown, vec3(1.0 / 2.4)) - 0.055;
  return mix(curve, 12.92 * shown, lessThanEqual(shown, vec3(0.0031308)));
}

void main() {
  vec3 n = normal;
  if (is_sphere) {
    float square = dot(n.xy, n.xy);
    if (square >= 1.0) discard;
    n.z = sqrt(1.0 - square);
  } else {
    n = normalize(n);
    // A hole, or a rim whose smooth normal looks away: no material has a value there.
    if (!gl_FrontFacing || n.z <= 0.0) {
      colour = vec4(0.0);
      return;
    }
  }
  float sine = length(n.xy);
  vec2 at = sine > 0.0 ? n.xy / sine * atan(sine, n.z) / reach : vec2(0.0);
  vec3 base, lobe;
  look_up(at, base, lobe);
  for (int k = 0; k < sources; ++k) {
    float incoming = dot(n, source_directions[k].xyz);
    if (incoming <= 0.0) continue;
    vec3 own_lobe;
    float own_base;
    reflected(incoming, n.z, source_directions[k].w, own_lobe, own_base);
    base += own_base * source_irradiances[k];
    lobe += own_lobe * source_irradiances[k];
  }
  if (weighted) lobe /= n.z;
  vec3 radiance = max(base_amount * base + lobe_amount * lobe, 0.0) * exposure;
  colour = vec4(linear_output ? radiance : encoded(radiance), 1.0);
}

// The object as a distant viewer sees it: the map at its normals, and sources by themselves.
const int MOST_SOURCES = 9;
const float PI = 3.14159265359;
uniform highp sampler2D base_map;
// One for each width.
uniform highp sampler2DArray lobe_map;
// Maps of a texture, relative to the amounts; rows go down from v = 1.
uniform bool textured;
uniform bool tilted;
uniform highp sampler2D kd_map;
uniform highp sampler2D ks_map;
uniform highp sampler2D width_map;
uniform highp sampler2D offset_map;
uniform vec3 map_scales;
// Of glTF's metal kd is its base colour and ks its share of metal; what it reflects head on.
uniform bool metal;
uniform float head_on;
uniform mat3 view_from_world;
// What is shown: 0 the object, 1 kd, 2 ks, 3 normals, 4 a map in false colours.
uniform int shown;
uniform highp sampler2D false_map;
uniform highp sampler2D false_colours;
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
in vec2 place;
layout(location = 0) out vec4 colour;

// Catmull and Rom's curve through four texels.
vec4 weights_of(float t) {
  return vec4(
    t * (-0.5 + t * (1.0 - 0.5 * t)), 1.0 + t * t * (-2.5 + 1.5 * t),
    t * (0.5 + t * (2.0 - 1.5 * t)), t * t * (-0.5 + 0.5 * t));
}

vec4 texel_of(highp sampler2D map, vec2 where) {
  ivec2 size = textureSize(map, 0);
  return texelFetch(map, min(ivec2(where * vec2(size)), size - 1), 0);
}

void look_up(vec2 at, float layer, out vec3 base, out vec3 lobe) {
  int lower = int(layer), upper = min(lower + 1, int(layers) - 1);
  float share = layer - float(lower);
  vec2 size = vec2(textureSize(base_map, 0));
  vec2 place = 0.5 + 0.5 * at;
  if (!smooth_map) {
    base = texture(base_map, place).rgb;
    lobe = mix(texture(lobe_map, vec3(place, lower)).rgb,
      texture(lobe_map, vec3(place, upper)).rgb, share);
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
      lobe += weight * mix(texelFetch(lobe_map, ivec3(at_texel, lower), 0).rgb,
        texelFetch(lobe_map, ivec3(at_texel, upper), 0).rgb, share);
    }
}

// What a normal sends to the viewer: base and lobe.
void gathered(vec3 n, float layer, out vec3 base, out vec3 lobe) {
  float sine = length(n.xy);
  vec2 at = sine > 0.0 ? n.xy / sine * atan(sine, n.z) / reach : vec2(0.0);
  look_up(at, layer, base, lobe);
  for (int k = 0; k < sources; ++k) {
    float incoming = dot(n, source_directions[k].xyz);
    if (incoming <= 0.0) continue;
    vec3 own_lobe;
    float own_base;
    reflected(incoming, n.z, source_directions[k].w, layer, own_lobe, own_base);
    base += own_base * source_irradiances[k];
    lobe += own_lobe * source_irradiances[k];
  }
  if (weighted) lobe /= n.z;
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
  vec3 kd = vec3(1.0), ks = vec3(1.0);
  float layer = 0.0;
  vec2 where = vec2(fract(place.x), fract(1.0 - place.y));
  if (textured) {
    if (is_sphere) {
      vec3 d = transpose(view_from_world) * n;
      where = vec2(
        fract(atan(d.y, d.x) / (2.0 * PI)), acos(clamp(d.z, -1.0, 1.0)) / PI);
    }
    kd = map_scales.x * texel_of(kd_map, where).rgb;
    ks = map_scales.y * texel_of(ks_map, where).rgb;
    layer = (rungs - 1.0) * texel_of(width_map, where).r;
    if (tilted) {
      vec3 offset = (255.0 * texel_of(offset_map, where).rgb - 128.0) / 127.0 * map_scales.z;
      offset = view_from_world * offset;
      n = normalize((1.0 - dot(n, offset)) * n + offset);
    }
    if (shown != 0) {
      vec3 flat_colour = encoded((metal ? 1.0 : PI) * base_amount * kd);
      if (shown == 2) flat_colour = encoded(ks / map_scales.y);
      if (shown == 3) flat_colour = 0.5 + 0.5 * n;
      if (shown == 4) {
        float code = 255.0 * texel_of(false_map, where).r;
        flat_colour = texelFetch(false_colours, ivec2(int(code + 0.5), 0), 0).rgb;
      }
      colour = vec4(flat_colour, 1.0);
      return;
    }
    if (n.z <= 0.0) {
      colour = vec4(0.0, 0.0, 0.0, 1.0);
      return;
    }
  }
  vec3 base, lobe, edge = vec3(0.0), ignored;
  gathered(n, layer, base, lobe);
  vec3 of_base = base_amount * kd, of_lobe = lobe_amount * ks;
  if (metal) {
    gathered(n, layer + rungs, ignored, edge);
    vec3 color = of_base, share = clamp(of_lobe, 0.0, 1.0);
    of_base = (1.0 - share) * (1.0 - head_on) * color;
    of_lobe = share * color + (1.0 - share) * head_on;
  }
  vec3 radiance = max(of_base * base + of_lobe * lobe + edge, 0.0) * exposure;
  colour = vec4(linear_output ? radiance : encoded(radiance), 1.0);
}

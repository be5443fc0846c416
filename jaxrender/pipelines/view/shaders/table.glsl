// The material as a table of log2: red, green and blue are the lobe, alpha is the base.  Of a grey
// one red is the lobe and green the base.  Where widths differ from place to place there are layers
// of the table, one after the other: that of width x exp(ladder.x + number x ladder.y).
uniform highp sampler3D table;
uniform vec3 table_nodes;
uniform float width;
uniform float layers;
// Of glTF's metal so many layers are of the lobe, and as many after them of its brighter edge.
uniform float rungs;
uniform vec2 ladder;
uniform float middle;
uniform bool weighted;
uniform bool grey;

const float FLOOR = -23.99;

float width_of(float layer) {
  return width * exp(ladder.x + (layer < rungs ? layer : layer - rungs) * ladder.y);
}

vec4 logarithm_at(vec3 place, float layer) {
  vec3 texel = place * (table_nodes - 1.0) + 0.5 + vec3(0.0, 0.0, layer * table_nodes.z);
  return texture(table, texel / (table_nodes * vec3(1.0, 1.0, layers)));
}

// Reflect a source of unit irradiance.  `incoming` and `outgoing` are cosines to the normal,
// `difference` is the cosine between either direction and the half vector.  Where the lobe is
// weighted, it comes times the outgoing cosine.
void reflected(float incoming, float outgoing, float difference, float layer, out vec3 lobe,
    out float base) {
  float half_cosine = min((incoming + outgoing) / (2.0 * difference), 1.0);
  float half_sine2 = max(1.0 - half_cosine * half_cosine, 0.0);
  float difference_sine2 = max(1.0 - difference * difference, 0.0);
  float turned = (incoming - difference * half_cosine)
    / sqrt(max(half_sine2 * difference_sine2, 1e-14));
  float ratio = sqrt(half_sine2) / (max(half_cosine, 1e-6) * width_of(layer));
  vec3 place = vec3(ratio / (ratio + middle), difference, clamp(0.5 + 0.5 * turned, 0.0, 1.0));
  float lower = floor(layer);
  vec4 logarithm = logarithm_at(place, lower);
  if (layer > lower) logarithm = mix(logarithm, logarithm_at(place, lower + 1.0), layer - lower);
  vec4 value;
  if (grey) {
    vec2 both = mix(exp2(logarithm.rg), vec2(0.0), lessThanEqual(logarithm.rg, vec2(FLOOR)));
    value = both.rrrg;
  } else {
    value = mix(exp2(logarithm), vec4(0.0), lessThanEqual(logarithm, vec4(FLOOR)));
  }
  lobe = value.rgb * (weighted ? 0.25 : incoming);
  base = value.a * incoming;
}

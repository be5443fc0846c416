// The material: its table at any width, for the shader and for the plots.

class Material {
  constructor(stored) {
    this.nodes = stored.nodes;
    this.middle = stored.middle;
    this.weighted = stored.weighted;
    this.widths = stored.widths;
    this.floor = stored.floor;
    this.parts = stored.parts;
    this.grey = stored.parts < 4;
    // Of glTF's metal a lobe and its brighter edge, over a base; head on it reflects so much.
    this.metal = stored.parts === 3;
    this.headOn = stored.head_on;
    const numbers = unpacked(stored.logarithms);
    this.size = this.nodes[0] * this.nodes[1] * this.nodes[2];
    this.tables = this.widths.map((_, k) =>
      numbers.subarray(k * this.size * this.parts, (k + 1) * this.size * this.parts));
    // Widths of the layers over the width, in equal steps of their logarithms.
    this.ratios = stored.ratios;
    this.at(this.widths[stored.fitted]);
  }

  // Make the tables of a width, and of every layer.
  at(width) {
    this.width = width;
    this.logarithms = this.tableAt(width);
    this.layers = this.ratios.map((ratio) =>
      (ratio === 1 ? this.logarithms : this.tableAt(width * ratio)));
    if (this.metal) this.layers.push(...this.layers.map((table) =>
      table.map((x, k) => (k % 4 === 0 ? table[k + 1] : x))));
  }

  // Put base and lobe together, by their amounts; of metal these are a colour and a share.
  mixed(base, lobe, values) {
    const { metal, headOn } = this;
    return [0, 1, 2].map((c) => {
      if (!metal) return base[c] * values.base + lobe[c] * values.lobe[c];
      const share = Math.min(Math.max(lobe[c], 0), 1), [facets, edge] = values.lobe;
      return (1 - share) * (1 - headOn) * base[c] * values.base
        + (share * base[c] + (1 - share) * headOn) * facets + edge;
    });
  }

  // The logarithm of the first layer's width over the width, and a step.
  get ladder() {
    const { ratios } = this, last = ratios.length - 1;
    const step = last > 0 ? Math.log(ratios[last] / ratios[0]) / last : 0;
    return [Math.log(ratios[0]), step];
  }

  // The tables about a width, and the weight of each: a polynomial in the width's logarithm.
  tablesAbout(width) {
    const { widths } = this, count = Math.min(4, widths.length);
    const held = Math.min(Math.max(width, widths[0]), widths[widths.length - 1]);
    const above = widths.findIndex((one) => one >= held);
    const first = Math.min(Math.max(above - 2, 0), widths.length - count);
    const places = widths.slice(first, first + count).map(Math.log), x = Math.log(held);
    return places.map((own, k) => [this.tables[first + k], places.reduce((product, other, j) =>
      (j === k ? product : product * (x - other) / (own - other)), 1)]);
  }

  // Interpolate the logarithms between the tables of some widths: rows of azimuth, difference, u.
  tableAt(width) {
    const about = this.tablesAbout(width), { floor } = this;
    const [nu, nd, na] = this.nodes;
    const found = new Float32Array(4 * this.size);
    const places = { 2: [0, 0, 0, 1], 3: [0, 1, 1, 2], 4: [0, 1, 2, 3] }[this.parts];
    for (let u = 0; u < nu; ++u)
      for (let d = 0; d < nd; ++d)
        for (let z = 0; z < na; ++z) {
          const from = this.parts * ((u * nd + d) * na + z), to = 4 * ((z * nd + d) * nu + u);
          for (let c = 0; c < 4; ++c) {
            const own = from + places[c];
            let sum = 0;
            for (const [table, weight] of about) sum += weight * table[own];
            found[to + c] = Math.max(sum, floor);
          }
        }
    return found;
  }

  // Evaluate lobe (three channels) and base in 1/sr, as the shader does.
  evaluate(half, difference, turned, incoming, outgoing) {
    const ratio = Math.tan(half) / this.width;
    const places = [ratio / (ratio + this.middle), difference, 0.5 + 0.5 * turned];
    const first = [], share = [];
    places.forEach((place, k) => {
      const at = Math.min(Math.max(place, 0), 1) * (this.nodes[k] - 1);
      first.push(Math.min(Math.floor(at), this.nodes[k] - 2));
      share.push(at - first[k]);
    });
    const total = [0, 0, 0, 0];
    for (let corner = 0; corner < 8; ++corner) {
      const bits = [corner & 1, (corner >> 1) & 1, corner >> 2];
      let weight = 1;
      bits.forEach((bit, k) => { weight *= bit ? share[k] : 1 - share[k]; });
      const [u, d, z] = bits.map((bit, k) => first[k] + bit);
      const row = 4 * ((z * this.nodes[1] + d) * this.nodes[0] + u);
      for (let c = 0; c < 4; ++c) total[c] += weight * this.logarithms[row + c];
    }
    const values = total.map((one) => (one <= this.floor + 0.01 ? 0 : 2 ** one));
    const factor = this.weighted ? 1 / (4 * Math.max(incoming * outgoing, 1e-4)) : 1;
    return { lobe: values.slice(0, 3).map((one) => one * factor), base: values[3] };
  }

  // Evaluate a pair of directions [x, y, z] about the normal +z.
  ofPair(towards, away) {
    const sum = towards.map((x, k) => x + away[k]), length = Math.hypot(...sum);
    const h = sum.map((x) => x / length);
    const difference = Math.min(towards[0] * h[0] + towards[1] * h[1] + towards[2] * h[2], 1);
    const half = Math.acos(Math.min(h[2], 1));
    const sines = Math.sqrt(Math.max((1 - difference ** 2) * (1 - h[2] ** 2), 1e-14));
    const turned = Math.min(Math.max((towards[2] - difference * h[2]) / sines, -1), 1);
    return this.evaluate(half, difference, turned, towards[2], away[2]);
  }
}

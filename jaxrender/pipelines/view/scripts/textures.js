// The maps of a texture, and which of them is shown in the place of the object.

const PLAIN = { picture: 0, kd: 1, ks: 2, normals: 3 }, FALSE_COLOURS = 4;

class TextureMaps {
  constructor(gl, stored) {
    this.gl = gl;
    this.stored = stored;
    const none = [255, 255, 255], texel = (codes) => ({ codes, shape: [1, 1], channels: 3 });
    const kept = (part, channels) => (part
      ? { codes: unpacked(part), shape: part.shape, channels } : texel(none));
    const { kd, ks, sigma, offset } = stored || {};
    // Colours are kept in sRGB, which the texture unit decodes.
    this.textures = [
      ["kd_map", this.map(kept(kd && kd.codes, 3), gl.SRGB8)],
      ["ks_map", this.map(kept(ks && ks.codes, ks ? ks.channels : 3), gl.SRGB8)],
      ["width_map", this.map(kept(sigma, 1), gl.RGB8)],
      ["offset_map", this.map(kept(offset && offset.codes, 3), gl.RGB8)],
      ["false_map", this.map(texel(none), gl.RGB8)],
      ["false_colours", this.map(texel(none), gl.RGB8)],
    ];
    this.scales = stored ? [kd.scale, ks.scale, offset ? offset.scale : 0] : [1, 1, 0];
  }

  // Put codes into a texture of three channels, a grey one three times.
  map({ codes, shape, channels }, format, texture = null) {
    const gl = this.gl, [rows, columns] = shape, found = texture || gl.createTexture();
    const three = channels === 3 ? Uint8Array.from(codes) : new Uint8Array(3 * codes.length);
    if (channels !== 3) codes.forEach((code, k) => three.fill(code, 3 * k, 3 * k + 3));
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, found);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texImage2D(
      gl.TEXTURE_2D, 0, format, columns, rows, 0, gl.RGB, gl.UNSIGNED_BYTE, three);
    for (const name of ["TEXTURE_MIN_FILTER", "TEXTURE_MAG_FILTER"])
      gl.texParameteri(gl.TEXTURE_2D, gl[name], gl.NEAREST);
    for (const name of ["TEXTURE_WRAP_S", "TEXTURE_WRAP_T"])
      gl.texParameteri(gl.TEXTURE_2D, gl[name], gl.CLAMP_TO_EDGE);
    return found;
  }

  // Take a map in false colours; what nobody saw is grey.
  overlay({ codes }, colours) {
    const of = (name) => this.textures.find(([own]) => own === name)[1];
    this.map({ codes: unpacked(codes), shape: codes.shape, channels: 1 }, this.gl.RGB8,
      of("false_map"));
    this.map({ codes: colours, shape: [1, 256], channels: 3 }, this.gl.RGB8,
      of("false_colours"));
  }

  use(places, shown) {
    const gl = this.gl;
    gl.uniform1i(places.textured, this.stored ? 1 : 0);
    gl.uniform1i(places.tilted, this.stored && this.stored.offset ? 1 : 0);
    gl.uniform3fv(places.map_scales, this.scales);
    gl.uniform1i(places.shown, shown);
  }
}

function textureControls(viewer) {
  const choice = viewer.byId("shown-choice");
  if (!choice) return;
  choice.addEventListener("change", () => viewer.chooseMap(choice.value));
  viewer.followers.push(() => {
    choice.value = viewer.state.map;
    for (const legend of viewer.all("[data-shown]"))
      legend.hidden = legend.dataset.shown !== choice.value;
  });
}

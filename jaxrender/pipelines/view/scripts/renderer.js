// The picture: a reflection map of what every normal sends to the viewer, then the object.

// Their sides in texels; a fine one has some texels for the width of a lobe.
const QUICK = 44, LEAST_FINE = 112, MOST_FINE = 256, TEXELS_PER_WIDTH = 3;
// Normals this far from the view are still in the map, in radians: a little beyond the rim.
const REACH = 0.5 * Math.PI * 1.08;
const TILE_SECONDS = 0.05;

class Renderer {
  constructor(canvas, scene, material, shaders) {
    const gl = canvas.getContext("webgl2", {
      alpha: true, antialias: scene.surface.kind === "mesh", preserveDrawingBuffer: true,
    });
    if (!gl) throw new Error("this browser has no WebGL2");
    if (!gl.getExtension("EXT_color_buffer_float"))
      throw new Error("this graphics processor draws no floating-point pictures");
    this.gl = gl;
    this.canvas = canvas;
    this.surface = scene.surface;
    this.material = material;
    this.maps = new TextureMaps(gl, scene.texture);
    this.square = this.squareOf();
    const lit = shaders.table;
    this.mapProgram = this.program(shaders.square, lit + shaders.map);
    const vertices = this.surface.kind === "mesh" ? shaders.mesh : shaders.sphere;
    this.objectProgram = this.program(vertices, lit + shaders.object);
    if (this.surface.kind === "mesh") this.loadMesh();
    this.table = gl.createTexture();
    this.loadTable();
    this.nodes = [0, 1, 2, 3].map(() => gl.createTexture());
    this.quick = this.mapOf(QUICK);
    this.fine = this.mapOf(LEAST_FINE);
    this.rows = 8;
  }

  program(vertex, fragment) {
    const gl = this.gl, program = gl.createProgram();
    const head = "#version 300 es\nprecision highp float;\nprecision highp int;\n";
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, head + text);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS))
        throw new Error(`a shader was refused: ${gl.getShaderInfoLog(shader)}`);
      gl.attachShader(program, shader);
    }
    gl.bindAttribLocation(program, 0, vertex.includes("in vec2 corner") ? "corner" : "position");
    if (vertex.includes("in vec3 direction")) gl.bindAttribLocation(program, 1, "direction");
    if (vertex.includes("in vec2 coordinate")) gl.bindAttribLocation(program, 2, "coordinate");
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS))
      throw new Error(`a shader was refused: ${gl.getProgramInfoLog(program)}`);
    const places = {};
    const count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS);
    for (let k = 0; k < count; ++k) {
      const name = gl.getActiveUniform(program, k).name.replace("[0]", "");
      places[name] = gl.getUniformLocation(program, name);
    }
    return { program, places };
  }

  squareOf() {
    const gl = this.gl, array = gl.createVertexArray();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]), gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);
    return array;
  }

  loadMesh() {
    const gl = this.gl, { lower, size } = this.surface;
    const steps = unpacked(this.surface.positions);
    const positions = Float32Array.from(steps, (x, k) => lower[k % 3] + size[k % 3] * x / 65535);
    const faces = unpacked(this.surface.faces);
    this.mesh = gl.createVertexArray();
    gl.bindVertexArray(this.mesh);
    const parts = [positions, unfolded(unpacked(this.surface.normals))];
    if (this.surface.coordinates) parts.push(unpacked(this.surface.coordinates));
    parts.forEach((numbers, place) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, numbers, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, place < 2 ? 3 : 2, gl.FLOAT, false, 0, 0);
    });
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STATIC_DRAW);
    this.indices = faces.length;
    this.indexKind = faces instanceof Uint16Array ? gl.UNSIGNED_SHORT : gl.UNSIGNED_INT;
  }

  loadTable() {
    const gl = this.gl, [u, d, z] = this.material.nodes;
    gl.bindTexture(gl.TEXTURE_3D, this.table);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 4);
    const { grey, layers } = this.material, logarithms = joined(layers);
    const kinds = grey ? [gl.RG16F, gl.RG] : [gl.RGBA16F, gl.RGBA];
    const texels = grey ? logarithms.filter((_, k) => k % 4 === 0 || k % 4 === 3) : logarithms;
    gl.texImage3D(gl.TEXTURE_3D, 0, kinds[0], u, d, z * layers.length, 0, kinds[1], gl.FLOAT, texels);
    for (const name of ["TEXTURE_MIN_FILTER", "TEXTURE_MAG_FILTER"])
      gl.texParameteri(gl.TEXTURE_3D, gl[name], gl.LINEAR);
    for (const name of ["TEXTURE_WRAP_S", "TEXTURE_WRAP_T", "TEXTURE_WRAP_R"])
      gl.texParameteri(gl.TEXTURE_3D, gl[name], gl.CLAMP_TO_EDGE);
  }

  flat(texture, format, width, height, numbers, filter) {
    const gl = this.gl;
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, format, width, height, 0, gl.RGBA, gl.FLOAT, numbers);
    for (const name of ["TEXTURE_MIN_FILTER", "TEXTURE_MAG_FILTER"])
      gl.texParameteri(gl.TEXTURE_2D, gl[name], filter);
    for (const name of ["TEXTURE_WRAP_S", "TEXTURE_WRAP_T"])
      gl.texParameteri(gl.TEXTURE_2D, gl[name], gl.CLAMP_TO_EDGE);
    return texture;
  }

  mapOf(size, old = null) {
    const gl = this.gl, layers = this.material.layers.length;
    if (old) {
      old.parts.forEach((texture) => gl.deleteTexture(texture));
      old.frames.forEach((frame) => gl.deleteFramebuffer(frame));
    }
    gl.activeTexture(gl.TEXTURE0);
    const base = this.flat(gl.createTexture(), gl.RGBA16F, size, size, null, gl.LINEAR);
    const lobes = gl.createTexture(), kind = gl.TEXTURE_2D_ARRAY;
    gl.bindTexture(kind, lobes);
    gl.texStorage3D(kind, 1, gl.RGBA16F, size, size, layers);
    for (const name of ["TEXTURE_MIN_FILTER", "TEXTURE_MAG_FILTER"])
      gl.texParameteri(kind, gl[name], gl.LINEAR);
    for (const name of ["TEXTURE_WRAP_S", "TEXTURE_WRAP_T"])
      gl.texParameteri(kind, gl[name], gl.CLAMP_TO_EDGE);
    // The base does not change with the width, so every layer may write it.
    const frames = this.material.layers.map((_, layer) => {
      const frame = gl.createFramebuffer();
      gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
      gl.framebufferTexture2D(
        gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, base, 0);
      gl.framebufferTextureLayer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT1, lobes, 0, layer);
      gl.drawBuffers([gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1]);
      return frame;
    });
    return { size, frames, parts: [base, lobes] };
  }

  // Turn nodes into the axes of the view, with the cosine between each and the half vector.
  load(nodes, turn, first, textures) {
    const gl = this.gl, { directions, irradiances } = nodes, count = directions.length / 3;
    const rows = Math.max(1, Math.ceil((count + 1) / 256));
    const found = new Float32Array(4 * 256 * rows), bright = new Float32Array(4 * 256 * rows);
    for (let k = 0; k < count; ++k) {
      const x = directions[3 * k], y = directions[3 * k + 1], z = directions[3 * k + 2];
      const towards = turn[6] * x + turn[7] * y + turn[8] * z;
      found[4 * k] = turn[0] * x + turn[1] * y + turn[2] * z;
      found[4 * k + 1] = turn[3] * x + turn[4] * y + turn[5] * z;
      found[4 * k + 2] = towards;
      found[4 * k + 3] = Math.sqrt(Math.max((1 + towards) / 2, 1e-6));
      for (let c = 0; c < 3; ++c) bright[4 * k + c] = irradiances[3 * k + c];
    }
    // Where the nodes of a cell begin, and those of the last one end.
    if (first) first.forEach((at, k) => { bright[4 * k + 3] = at; });
    gl.activeTexture(gl.TEXTURE0);
    this.flat(textures[0], gl.RGBA32F, 256, rows, found, gl.NEAREST);
    this.flat(textures[1], gl.RGBA32F, 256, rows, bright, gl.NEAREST);
    return count;
  }

  useLight(light, view, exact) {
    const turn = product(view, light.turn);
    this.cells = this.load(light.cells, turn, light.first, this.nodes.slice(0, 2));
    this.exact = exact && Boolean(light.fine);
    if (this.exact) this.load(light.fine, turn, null, this.nodes.slice(2));
  }

  bind(program, textures) {
    const gl = this.gl, { places } = program;
    gl.useProgram(program.program);
    textures.forEach(([name, kind, texture], unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(kind, texture);
      gl.uniform1i(places[name], unit);
    });
    gl.uniform3fv(places.table_nodes, this.material.nodes);
    gl.uniform1f(places.width, this.material.width);
    gl.uniform1f(places.middle, this.material.middle);
    gl.uniform1f(places.layers, this.material.layers.length);
    gl.uniform1f(places.rungs, this.material.ratios.length);
    gl.uniform2fv(places.ladder, this.material.ladder);
    gl.uniform1i(places.weighted, this.material.weighted ? 1 : 0);
    gl.uniform1i(places.grey, this.material.grey ? 1 : 0);
    gl.uniform1f(places.reach, REACH);
  }

  // Fill rows of a map with the light that is in use.
  drawMap(map, first, rows) {
    const gl = this.gl;
    gl.viewport(0, 0, map.size, map.size);
    gl.disable(gl.DEPTH_TEST);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(0, first, map.size, rows);
    this.bind(this.mapProgram, [
      ["table", gl.TEXTURE_3D, this.table],
      ["cell_directions", gl.TEXTURE_2D, this.nodes[0]],
      ["cell_irradiances", gl.TEXTURE_2D, this.nodes[1]],
      ["directions", gl.TEXTURE_2D, this.nodes[2]],
      ["irradiances", gl.TEXTURE_2D, this.nodes[3]],
    ]);
    gl.uniform1i(this.mapProgram.places.cells, this.cells);
    gl.uniform1i(this.mapProgram.places.exact, this.exact ? 1 : 0);
    gl.bindVertexArray(this.square);
    map.frames.forEach((frame, layer) => {
      gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
      gl.uniform1f(this.mapProgram.places.layer, layer);
      gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    });
    gl.disable(gl.SCISSOR_TEST);
  }

  drawQuick(light, view) {
    this.useLight(light, view, false);
    this.drawMap(this.quick, 0, this.quick.size);
  }

  // Fill the fine map a few rows at a time; calls `done` at the end unless `stopped()` says so.
  drawFine(light, view, stopped, done) {
    const gl = this.gl;
    const narrowest = this.material.width * Math.min(...this.material.ratios);
    const wanted = Math.round(TEXELS_PER_WIDTH * 2 * REACH / (2 * narrowest));
    const size = Math.min(Math.max(wanted, LEAST_FINE), MOST_FINE);
    if (size !== this.fine.size) this.fine = this.mapOf(size, this.fine);
    this.useLight(light, view, true);
    let first = 0;
    const step = () => {
      if (stopped()) return;
      if (first >= this.fine.size) return done();
      const rows = Math.min(Math.max(1, Math.round(this.rows)), this.fine.size - first);
      const start = performance.now();
      this.drawMap(this.fine, first, rows);
      first += rows;
      const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
      gl.flush();
      const wait = () => {
        const state = gl.clientWaitSync(fence, 0, 0);
        if (state === gl.TIMEOUT_EXPIRED) return setTimeout(wait, 2);
        gl.deleteSync(fence);
        const seconds = (performance.now() - start) / 1000;
        this.rows *= Math.min(Math.max(TILE_SECONDS / Math.max(seconds, 1e-4), 0.5), 2);
        this.rows = Math.min(this.rows, this.fine.size);
        setTimeout(step, 0);
      };
      wait();
    };
    step();
  }

  // Draw the object; `state` says what it is made of, what lights it and how it is shown.
  draw(state, map, target = null, size = null) {
    const gl = this.gl, program = this.objectProgram, { places } = program;
    const [columns, rows] = size || [this.canvas.width, this.canvas.height];
    gl.bindFramebuffer(gl.FRAMEBUFFER, target);
    gl.viewport(0, 0, columns, rows);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    this.bind(program, [
      ["table", gl.TEXTURE_3D, this.table],
      ["base_map", gl.TEXTURE_2D, map.parts[0]],
      ["lobe_map", gl.TEXTURE_2D_ARRAY, map.parts[1]],
      ...this.maps.textures.map(([name, texture]) => [name, gl.TEXTURE_2D, texture]),
    ]);
    this.maps.use(places, state.shown);
    gl.uniformMatrix3fv(places.view_from_world, true, state.view);
    gl.uniform1i(places.smooth_map, map === this.fine ? 1 : 0);
    gl.uniform1i(places.is_sphere, this.surface.kind === "sphere" ? 1 : 0);
    gl.uniform1i(places.linear_output, target ? 1 : 0);
    gl.uniform1i(places.metal, this.material.metal ? 1 : 0);
    gl.uniform1f(places.head_on, this.material.headOn);
    gl.uniform3fv(places.base_amount, state.base);
    gl.uniform3fv(places.lobe_amount, state.lobe);
    gl.uniform1f(places.exposure, state.exposure);
    const sources = state.sources.map((one) => {
      const towards = applied(state.view, one.direction);
      return [...towards, Math.sqrt(Math.max((1 + towards[2]) / 2, 1e-6))];
    });
    gl.uniform1i(places.sources, sources.length);
    if (sources.length) {
      gl.uniform4fv(places.source_directions, sources.flat());
      gl.uniform3fv(places.source_irradiances, state.sources.flatMap((one) => one.irradiance));
    }
    const extent = state.extent;
    gl.uniform1f(places.extent, extent);
    if (this.surface.kind === "sphere") {
      gl.uniform1f(places.radius, this.surface.radius);
      gl.disable(gl.DEPTH_TEST);
      gl.bindVertexArray(this.square);
      gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
      return;
    }
    gl.uniform3fv(places.center, this.surface.center);
    gl.uniform1f(places.depth, 1.01 * this.surface.radius);
    gl.enable(gl.DEPTH_TEST);
    gl.bindVertexArray(this.mesh);
    gl.drawElements(gl.TRIANGLES, this.indices, this.indexKind, 0);
  }

  // Give the graphics processor back: a browser has room for few pictures.
  close() {
    const lost = this.gl.getExtension("WEBGL_lose_context");
    if (lost) lost.loseContext();
  }

  // Find the exposure that takes the 95th percentile of the picture to just below white.
  exposureFor(state, map) {
    const gl = this.gl, size = 64;
    if (!this.probe) {
      const texture = this.flat(gl.createTexture(), gl.RGBA32F, size, size, null, gl.NEAREST);
      const frame = gl.createFramebuffer(), depth = gl.createRenderbuffer();
      gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
      gl.framebufferTexture2D(
        gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
      gl.bindRenderbuffer(gl.RENDERBUFFER, depth);
      gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT24, size, size);
      gl.framebufferRenderbuffer(
        gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, depth);
      this.probe = frame;
    }
    this.draw({ ...state, exposure: 1, shown: 0 }, map, this.probe, [size, size]);
    const numbers = new Float32Array(4 * size * size);
    gl.readPixels(0, 0, size, size, gl.RGBA, gl.FLOAT, numbers);
    const seen = [];
    for (let k = 0; k < size * size; ++k)
      if (numbers[4 * k + 3] > 0) seen.push(...numbers.subarray(4 * k, 4 * k + 3));
    if (!seen.length) return state.exposure;
    const bright = seen.sort((a, b) => a - b)[Math.floor(0.95 * (seen.length - 1))];
    return bright > 0 ? 0.8 / bright : state.exposure;
  }
}

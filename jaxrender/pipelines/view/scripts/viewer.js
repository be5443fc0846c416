// What is shown, and when: a quick picture at once, the exact one when nothing changes any more.

// At least so long after the last change, and not while a slow machine draws a few more frames.
const SETTLE_MILLISECONDS = 120, SETTLE_FRAMES = 3;
// A slower machine than this draws no more pixels than it must.
const SLOW_SECONDS = 0.08, FEWEST_PIXELS = 512, MOST_PIXELS = 1024;

class Viewer {
  constructor(scene, canvas, shaders) {
    this.scene = scene;
    this.canvas = canvas;
    // A page of its own, or a part of another one.
    this.root = canvas.getRootNode();
    this.outer = this.root.host || this.root.documentElement;
    this.material = new Material(scene.material);
    this.renderer = new Renderer(canvas, scene, this.material, shaders);
    this.coefficients = unpacked(scene.lights.result.coefficients);
    this.lights = {};
    for (const [name, light] of Object.entries(scene.lights))
      this.lights[name] = {
        fine: this.nodesOf(light.fine), cells: this.nodesOf(light.cells),
        first: unpacked(light.first),
        sources: this.sourcesOf(this.nodesOf(light.sources)),
      };
    this.total = this.totalOf();
    const [azimuth, elevation] = scene.view;
    this.state = {
      azimuth, elevation, zoom: 1, exposure: scene.exposure,
      base: [...scene.material.base], lobe: [...scene.material.lobe],
      width: this.material.width, light: "result", turn: IDENTITY, map: "picture", shown: 0,
      lamp: { on: false, azimuth: azimuth + 0.6, elevation: 0.7, strength: 1 },
      harmonics: Float32Array.from(this.coefficients),
    };
    this.change = 0;
    this.mapped = -1;
    this.frames = [];
    this.limit = MOST_PIXELS;
    this.fixedSize = null;
    // What is done after every picture, such as moving the sliders to where they belong.
    this.followers = [];
  }

  byId(name) {
    return this.root.getElementById(name);
  }

  all(selector) {
    return this.root.querySelectorAll(selector);
  }

  nodesOf(stored) {
    return {
      directions: unfolded(unpacked(stored.directions)),
      irradiances: unpacked(stored.irradiance).map((x) => x * stored.scale),
    };
  }

  sourcesOf({ directions, irradiances }) {
    const found = [];
    for (let k = 0; 3 * k < directions.length; ++k)
      found.push({
        direction: Array.from(directions.slice(3 * k, 3 * k + 3)),
        irradiance: Array.from(irradiances.slice(3 * k, 3 * k + 3)),
      });
    return found;
  }

  // The mean over the channels of the irradiance of all nodes of the result's light together.
  totalOf() {
    const { result } = this.lights, nodes = result.fine.irradiances.reduce((sum, x) => sum + x, 0);
    const sources = result.sources.reduce(
      (sum, one) => sum + one.irradiance[0] + one.irradiance[1] + one.irradiance[2], 0);
    return (nodes + sources) / 3;
  }

  // What surrounds the object, to be summed at many normals.
  surrounding() {
    const { light, turn } = this.state;
    if (light === "harmonics") return { cells: this.harmonicNodes(), turn };
    if (light === "uniform") return { cells: this.harmonicNodes([1 / 0.2820948]), turn };
    if (light === "dark")
      return { cells: { directions: new Float32Array(0), irradiances: [] }, turn };
    return { ...this.lights[light], turn };
  }

  // Light of a few coefficients, summed on a grid of its own (T 4.3.3).
  harmonicNodes(uniform = null) {
    const rows = 24, columns = 48, directions = [], irradiances = [];
    const level = this.total / (4 * Math.PI);
    for (let row = 0; row < rows; ++row) {
      const polar = (row + 0.5) * Math.PI / rows;
      // The solid angle between two circles of latitude.
      const weight = 2 * Math.sin(polar) * Math.sin(0.5 * Math.PI / rows) * 2 * Math.PI / columns;
      for (let column = 0; column < columns; ++column) {
        const azimuth = (column + 0.5) * 2 * Math.PI / columns;
        const d = directionOf(azimuth, 0.5 * Math.PI - polar);
        directions.push(...d);
        const basis = harmonicsOf(d);
        for (let c = 0; c < 3; ++c) {
          let radiance = 0;
          if (uniform) radiance = level * uniform[0] * basis[0];
          else basis.forEach((y, k) => { radiance += y * this.state.harmonics[3 * k + c]; });
          irradiances.push(weight * radiance);
        }
      }
    }
    return {
      directions: Float32Array.from(directions), irradiances: Float32Array.from(irradiances),
    };
  }

  sources() {
    const { light, lamp, turn } = this.state, given = this.lights[light];
    const found = (given ? given.sources : []).map(({ direction, irradiance }) => (
      { direction: applied(turn, direction), irradiance }));
    if (lamp.on) {
      const strength = lamp.strength * this.total / 4;
      found.push({ direction: directionOf(lamp.azimuth, lamp.elevation),
        irradiance: [strength, strength, strength] });
    }
    return found;
  }

  drawn() {
    const { azimuth, elevation, zoom, base, lobe, exposure, shown } = this.state;
    return {
      base, lobe, exposure, shown, sources: this.sources(), view: viewFromWorld(azimuth, elevation),
      extent: this.scene.surface.radius * this.scene.margin / zoom,
    };
  }

  // Something changed: the map too, unless it is colours, exposure or the lamp alone.
  changed(map = true) {
    if (map) this.change += 1;
    if (!this.waiting) {
      this.waiting = true;
      requestAnimationFrame(() => { this.waiting = false; this.frame(); });
    }
  }

  setWidth(width) {
    this.state.width = width;
    this.material.at(width);
    this.renderer.loadTable();
    this.changed();
  }

  // A slow machine draws a quarter of the pixels while something moves.
  resize(moving) {
    const css = this.canvas.clientWidth || FEWEST_PIXELS;
    const wanted = Math.round(css * (window.devicePixelRatio || 1));
    const whole = Math.max(64, Math.min(wanted, this.limit));
    const slow = moving && this.limit === FEWEST_PIXELS;
    const size = this.fixedSize || (slow ? whole >> 1 : whole);
    if (this.canvas.width !== size) this.canvas.width = this.canvas.height = size;
  }

  frame() {
    const start = performance.now(), state = this.drawn();
    const moving = this.mapped !== this.change;
    this.resize(moving);
    if (!moving) {
      this.show(state, this.renderer.fine);
      this.settled();
      return;
    }
    this.outer.dataset.state = "moving";
    this.renderer.drawQuick(this.surrounding(), state.view);
    this.show(state, this.renderer.quick);
    this.measure(start);
    clearTimeout(this.timer);
    const pause = Math.max(SETTLE_MILLISECONDS, 1000 * SETTLE_FRAMES * this.usual());
    this.timer = setTimeout(() => this.refine(), pause);
  }

  // The usual seconds of a frame.
  usual() {
    return [...this.frames].sort((a, b) => a - b)[this.frames.length >> 1] || 0;
  }

  show(state, map) {
    if (this.exposeNext) {
      this.state.exposure = state.exposure = this.renderer.exposureFor(state, map);
      this.exposeNext = false;
    }
    this.renderer.draw(state, map);
    this.followers.forEach((follow) => follow());
  }

  // Learn from the time that the graphics processor takes how many pixels it can draw.
  measure(start) {
    const gl = this.renderer.gl, fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    const wait = () => {
      if (gl.clientWaitSync(fence, 0, 0) === gl.TIMEOUT_EXPIRED) return setTimeout(wait, 2);
      gl.deleteSync(fence);
      if (!this.frames.length) performance.mark("first-image");
      this.frames = [...this.frames.slice(-7), (performance.now() - start) / 1000];
      if (this.frames.length >= 4 && this.usual() > SLOW_SECONDS) this.limit = FEWEST_PIXELS;
    };
    wait();
  }

  refine() {
    const change = this.change, { view } = this.drawn();
    this.renderer.drawFine(this.surrounding(), view, () => this.change !== change, () => {
      this.mapped = change;
      this.resize(false);
      this.show(this.drawn(), this.renderer.fine);
      this.settled();
    });
  }

  settled() {
    this.outer.dataset.state = "settled";
  }

  // The exposure in stops over that of the first picture.
  get stops() {
    return Math.log2(this.state.exposure / this.scene.exposure);
  }

  set stops(stops) {
    this.state.exposure = this.scene.exposure * 2 ** stops;
    this.changed(false);
  }

  chooseLight(name) {
    this.state.light = name;
    if (name === "dark") this.state.lamp.on = true;
    this.changed();
    this.expose();
  }

  // Show a map of the texture in the place of the object, or the object again.
  chooseMap(name) {
    const asked = this.scene.texture.overlays.find((one) => one.id === name);
    if (asked) this.renderer.maps.overlay(asked, unpacked(this.scene.false_colours));
    this.state.map = name;
    this.state.shown = asked ? FALSE_COLOURS : PLAIN[name];
    this.changed(false);
  }

  expose() {
    this.exposeNext = true;
    this.changed(false);
  }

  turnLight(across, upwards) {
    const view = viewFromWorld(this.state.azimuth, this.state.elevation);
    const about = rotationAbout([0, 0, 1], across);
    const tilt = rotationAbout(view.slice(0, 3), -upwards);
    this.state.turn = product(tilt, product(about, this.state.turn));
    this.changed();
  }

  orbit(across, upwards) {
    this.state.azimuth -= across;
    this.state.elevation = Math.min(Math.max(this.state.elevation - upwards, -1.55), 1.55);
    this.changed();
  }

  moveLamp(across, upwards) {
    const { lamp } = this.state;
    lamp.azimuth += across;
    lamp.elevation = Math.min(Math.max(lamp.elevation + upwards, -1.55), 1.55);
    this.changed(false);
  }
}

// Real harmonics up to degree 2, orthonormal and without the sign of Condon and Shortley.
function harmonicsOf([x, y, z]) {
  return [
    0.28209479, 0.48860251 * y, 0.48860251 * z, 0.48860251 * x,
    1.09254843 * x * y, 1.09254843 * y * z, 0.31539157 * (3 * z * z - 1),
    1.09254843 * x * z, 0.54627422 * (x * x - y * y),
  ];
}

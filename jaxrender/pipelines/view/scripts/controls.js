// Sliders, buttons, the pointer and the keyboard.

const STEP = Math.PI / 36;

function shown(value) {
  return Number(value.toPrecision(3)).toString();
}

// Where a slider's mark and band lie: shares of its track.
function markOf(slider, value, band) {
  const low = Number(slider.min), high = Number(slider.max);
  const place = (x) => Math.min(Math.max((x - low) / (high - low), 0), 1);
  const track = slider.parentElement;
  track.style.setProperty("--mark", place(value));
  track.style.setProperty("--from", place(band ? band[0] : value));
  track.style.setProperty("--to", place(band ? band[1] : value));
}

// A slider that changes the viewer, and follows whatever else changes it.
function tied(viewer, id, read, write, curve = {}) {
  const slider = viewer.byId(id), output = viewer.byId(`value-${id}`);
  const { toSlider = Number, toValue = Number, words = shown } = curve;
  slider.addEventListener("input", () => write(toValue(Number(slider.value))));
  viewer.followers.push(() => {
    const value = read();
    slider.value = toSlider(value);
    output.textContent = words(value);
    slider.setAttribute("aria-valuetext", words(value));
  });
  return slider;
}

function materialControls(viewer) {
  const { state } = viewer;
  for (const one of viewer.scene.sliders) {
    const curve = one.logarithmic ? { toSlider: Math.log, toValue: Math.exp } : {};
    const toSlider = curve.toSlider || Number, isWidth = one.part === "width";
    const write = (value) => {
      if (isWidth) return viewer.setWidth(widthOf(one, value));
      for (const channel of one.channels) state[one.part][channel] = value;
      viewer.changed(false);
    };
    const read = () => (isWidth ? numberOf(one, state.width) : state[one.part][one.channels[0]]);
    const slider = tied(viewer, `slider-${one.id}`, read, write, curve);
    const [low, high] = [one.lowest, one.highest].map(toSlider);
    [slider.min, slider.max, slider.step] = [low, high, (high - low) / 400];
    if (one.fitted) markOf(slider, toSlider(one.value), one.band && one.band.map((x) =>
      Math.min(Math.max(x > 0 || !one.logarithmic ? toSlider(x) : low, low), high)));
    viewer.byId("fitted").addEventListener("click", () => write(one.value));
  }
}

// The width of a lobe and the model's own number stand for each other.
function widthOf(slider, value) {
  return (value / slider.scale) ** (1 / slider.power);
}

function numberOf(slider, width) {
  return slider.scale * width ** slider.power;
}

function lightControls(viewer) {
  const { state } = viewer, byId = (id) => viewer.byId(id);
  for (const radio of viewer.all("input[name=light]")) {
    radio.addEventListener("change", () => viewer.chooseLight(radio.value));
    viewer.followers.push(() => { radio.checked = radio.value === state.light; });
  }
  const lamp = byId("lamp");
  lamp.addEventListener("change", () => {
    state.lamp.on = lamp.checked;
    viewer.changed(false);
  });
  viewer.followers.push(() => {
    lamp.checked = state.lamp.on;
    byId("lamp-settings").hidden = !state.lamp.on;
    byId("harmonics").hidden = state.light !== "harmonics";
  });
  for (const [name, factor] of [["azimuth", Math.PI / 180], ["elevation", Math.PI / 180],
    ["strength", 1]]) {
    const write = (value) => {
      state.lamp[name] = value * factor;
      viewer.changed(false);
    };
    const read = () => {
      const value = state.lamp[name] / factor;
      return name === "azimuth" ? value - 360 * Math.round(value / 360) : value;
    };
    tied(viewer, `lamp-${name}`, read, write);
  }
  byId("upright").addEventListener("click", () => {
    state.turn = IDENTITY;
    viewer.changed();
  });
  byId("expose").addEventListener("click", () => viewer.expose());
  tied(viewer, "exposure", () => viewer.stops, (value) => { viewer.stops = value; },
    { words: (value) => `${value >= 0 ? "+" : ""}${value.toFixed(1)}` });
  harmonicControls(viewer);
}

function harmonicControls(viewer) {
  const given = viewer.coefficients, { state } = viewer;
  const mean = (numbers, k) => (numbers[3 * k] + numbers[3 * k + 1] + numbers[3 * k + 2]) / 3;
  const colour = [0, 1, 2].map((c) => (mean(given, 0) > 0 ? given[c] / mean(given, 0) : 1));
  const unit = Math.max(mean(given, 0), 1e-12);
  for (const { id, dataset } of viewer.all("input[data-coefficient]")) {
    const k = Number(dataset.coefficient);
    const write = (value) => {
      const more = value * unit - mean(given, k);
      for (let c = 0; c < 3; ++c) state.harmonics[3 * k + c] = given[3 * k + c] + more * colour[c];
      viewer.changed();
    };
    const slider = tied(viewer, id, () => mean(state.harmonics, k) / unit, write);
    markOf(slider, mean(given, k) / unit, null);
    viewer.byId("given-harmonics").addEventListener("click", () => write(mean(given, k) / unit));
  }
}

function dragged(viewer) {
  const { canvas, state } = viewer, pointers = new Map();
  const what = () => viewer.root.querySelector("input[name=drag]:checked").value;
  const move = (across, upwards) => {
    if (what() === "light") viewer.turnLight(across, upwards);
    else if (what() === "lamp") {
      state.lamp.on = true;
      viewer.moveLamp(across, upwards);
    } else viewer.orbit(across, upwards);
  };
  const zoom = (factor) => {
    state.zoom = Math.min(Math.max(state.zoom * factor, 0.3), 8);
    viewer.changed(false);
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
  });
  canvas.addEventListener("pointermove", (event) => {
    const last = pointers.get(event.pointerId);
    if (!last) return;
    const spread = () => {
      const [a, b] = [...pointers.values()];
      return Math.hypot(a[0] - b[0], a[1] - b[1]);
    };
    const before = pointers.size === 2 ? spread() : 0;
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    if (pointers.size === 2) return zoom(spread() / Math.max(before, 1));
    const scale = Math.PI / canvas.clientWidth;
    move((event.clientX - last[0]) * scale, (last[1] - event.clientY) * scale);
  });
  for (const name of ["pointerup", "pointercancel"])
    canvas.addEventListener(name, (event) => pointers.delete(event.pointerId));
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(-event.deltaY / 600));
  }, { passive: false });
  const keys = {
    ArrowLeft: () => move(-STEP, 0), ArrowRight: () => move(STEP, 0),
    ArrowUp: () => move(0, STEP), ArrowDown: () => move(0, -STEP),
    "+": () => zoom(1.15), "=": () => zoom(1.15), "-": () => zoom(1 / 1.15),
    Home: () => {
      [state.azimuth, state.elevation] = viewer.scene.view;
      Object.assign(state, { zoom: 1, turn: IDENTITY });
      viewer.changed();
    },
  };
  canvas.addEventListener("keydown", (event) => {
    if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    keys[event.key]();
  });
}

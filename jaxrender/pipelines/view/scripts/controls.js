// Sliders, buttons, the pointer and the keyboard.

const STEP = Math.PI / 36;

function byId(name) {
  return document.getElementById(name);
}

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

function materialControls(viewer) {
  for (const one of viewer.scene.sliders) {
    const slider = byId(`slider-${one.id}`), output = byId(`value-${one.id}`);
    const toSlider = one.logarithmic ? Math.log : (x) => x;
    const toValue = one.logarithmic ? Math.exp : (x) => x;
    slider.min = toSlider(one.lowest);
    slider.max = toSlider(one.highest);
    slider.step = (slider.max - slider.min) / 400;
    slider.value = toSlider(one.value);
    const [low, high] = [one.lowest, one.highest].map(toSlider);
    if (one.fitted) markOf(slider, toSlider(one.value), one.band && one.band.map((x) =>
      Math.min(Math.max(x > 0 || !one.logarithmic ? toSlider(x) : low, low), high)));
    const use = (value) => {
      output.textContent = shown(value);
      slider.setAttribute("aria-valuetext", shown(value));
      if (one.part === "width") viewer.setWidth((value / one.scale) ** (1 / one.power));
      else {
        for (const channel of one.channels) viewer.state[one.part][channel] = value;
        viewer.changed(false);
      }
    };
    output.textContent = shown(one.value);
    slider.addEventListener("input", () => use(toValue(Number(slider.value))));
    byId("fitted").addEventListener("click", () => {
      slider.value = toSlider(one.value);
      use(one.value);
    });
  }
}

function lightControls(viewer) {
  const { state } = viewer;
  for (const radio of document.querySelectorAll("input[name=light]"))
    radio.addEventListener("change", () => {
      state.light = radio.value;
      byId("harmonics").hidden = radio.value !== "harmonics";
      if (radio.value === "dark") setLamp(true);
      viewer.changed();
      viewer.expose();
    });
  const lamp = byId("lamp");
  const setLamp = (on) => {
    lamp.checked = state.lamp.on = on;
    byId("lamp-settings").hidden = !on;
  };
  lamp.addEventListener("change", () => { setLamp(lamp.checked); viewer.changed(false); });
  const followers = [];
  for (const [name, factor] of [["azimuth", Math.PI / 180], ["elevation", Math.PI / 180],
    ["strength", 1]]) {
    const slider = byId(`lamp-${name}`), output = byId(`value-lamp-${name}`);
    slider.addEventListener("input", () => {
      state.lamp[name] = Number(slider.value) * factor;
      viewer.changed(false);
    });
    // A lamp that is dragged takes its sliders along.
    followers.push(() => {
      const value = state.lamp[name] / factor;
      const turned = name === "azimuth" ? value - 360 * Math.round(value / 360) : value;
      slider.value = turned;
      output.textContent = shown(turned);
    });
  }
  byId("upright").addEventListener("click", () => {
    state.turn = IDENTITY;
    viewer.changed();
  });
  byId("expose").addEventListener("click", () => viewer.expose());
  const stops = byId("exposure");
  stops.addEventListener("input", () => {
    state.exposure = viewer.scene.exposure * 2 ** Number(stops.value);
    viewer.changed(false);
  });
  viewer.onDraw = () => {
    const value = Math.log2(state.exposure / viewer.scene.exposure);
    followers.forEach((follow) => follow());
    stops.value = value;
    byId("value-exposure").textContent = `${value >= 0 ? "+" : ""}${value.toFixed(1)}`;
  };
  harmonicControls(viewer);
}

function harmonicControls(viewer) {
  const given = viewer.coefficients, mean = (k) =>
    (given[3 * k] + given[3 * k + 1] + given[3 * k + 2]) / 3;
  const colour = [0, 1, 2].map((c) => (mean(0) > 0 ? given[c] / mean(0) : 1));
  for (const slider of document.querySelectorAll("input[data-coefficient]")) {
    const k = Number(slider.dataset.coefficient), unit = Math.max(mean(0), 1e-12);
    const output = byId(`value-${slider.id}`);
    slider.value = mean(k) / unit;
    markOf(slider, mean(k) / unit, null);
    output.textContent = shown(mean(k) / unit);
    const use = (value) => {
      for (let c = 0; c < 3; ++c)
        viewer.state.harmonics[3 * k + c]
          = given[3 * k + c] + (value - mean(k) / unit) * unit * colour[c];
      output.textContent = shown(value);
      viewer.changed();
    };
    slider.addEventListener("input", () => use(Number(slider.value)));
    byId("given-harmonics").addEventListener("click", () => {
      slider.value = mean(k) / unit;
      use(mean(k) / unit);
    });
  }
}

function dragged(viewer) {
  const { canvas, state } = viewer, pointers = new Map();
  const what = () => document.querySelector("input[name=drag]:checked").value;
  const move = (across, upwards) => {
    if (what() === "light") viewer.turnLight(across, upwards);
    else if (what() === "lamp") {
      if (!state.lamp.on) byId("lamp").click();
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

// The object in a notebook: what Python sets is shown, and what a person chooses goes back.

const DEGREE = Math.PI / 180;

// What Python and the viewer share: how each trait is read from the viewer, and how it is set.
function traitsOf(viewer) {
  const { state } = viewer, width = viewer.scene.sliders.find((one) => one.part === "width");
  const of = (name, factor, map) => ({
    read: () => state[name] / factor,
    write: (value) => { state[name] = value * factor; viewer.changed(map); },
  });
  const amounts = (name) => ({
    read: () => [...state[name]],
    write: (value) => { state[name].splice(0, 3, ...value); viewer.changed(false); },
  });
  const traits = {
    light: { read: () => state.light, write: (name) => viewer.chooseLight(name) },
    base: amounts("base"),
    lobe: amounts("lobe"),
    azimuth: of("azimuth", DEGREE, true),
    elevation: of("elevation", DEGREE, true),
    zoom: of("zoom", 1, false),
    stops: { read: () => viewer.stops, write: (value) => { viewer.stops = value; } },
    lamp: {
      read: () => {
        const { on, azimuth, elevation, strength } = state.lamp;
        return on ? [azimuth / DEGREE, elevation / DEGREE, strength] : null;
      },
      write: (value) => {
        state.lamp.on = value !== null;
        if (value !== null) {
          const [azimuth, elevation, strength] = value;
          Object.assign(state.lamp,
            { azimuth: azimuth * DEGREE, elevation: elevation * DEGREE, strength });
        }
        viewer.changed(false);
      },
    },
    turn: {
      read: () => rows(state.turn),
      write: (value) => { state.turn = value.flat(); viewer.changed(); },
    },
    coefficients: {
      read: () => rows([...state.harmonics]),
      write: (value) => { state.harmonics.set(value.flat()); viewer.changed(); },
    },
  };
  if (width) traits.roughness = {
    read: () => numberOf(width, state.width),
    write: (value) => viewer.setWidth(widthOf(width, value)),
  };
  if (viewer.scene.texture)
    traits.shown = { read: () => state.map, write: (name) => viewer.chooseMap(name) };
  return traits;
}

function rows(numbers) {
  return Array.from({ length: numbers.length / 3 }, (_, k) => numbers.slice(3 * k, 3 * k + 3));
}

// Whether two values are the same but for rounding, so that no echo goes back and forth.
function alike(a, b) {
  if (Array.isArray(a) && Array.isArray(b))
    return a.length === b.length && a.every((x, k) => alike(x, b[k]));
  if (typeof a === "number" && typeof b === "number")
    return Math.abs(a - b) <= 1e-6 * Math.max(Math.abs(a), Math.abs(b), 1e-6);
  return a === b;
}

// Tie viewer and model together; returns what parts them again.
function tiedTo(model, viewer) {
  const traits = traitsOf(viewer), ends = [];
  for (const [name, { read, write }] of Object.entries(traits)) {
    const take = () => { if (!alike(model.get(name), read())) write(model.get(name)); };
    take();
    model.on(`change:${name}`, take);
    ends.push(() => model.off(`change:${name}`, take));
  }
  viewer.followers.push(() => {
    const chosen = Object.entries(traits).map(([name, { read }]) => [name, read()])
      .filter(([name, value]) => !alike(model.get(name), value));
    for (const [name, value] of chosen) model.set(name, value);
    if (chosen.length) model.save_changes();
  });
  return () => ends.forEach((end) => end());
}

function render({ model, el }) {
  const host = document.createElement("div"), root = host.attachShadow({ mode: "open" });
  const style = document.createElement("style"), place = document.createElement("div");
  // A notebook has keys of its own; here they turn the object.
  host.dataset.lmSuppressShortcuts = "true";
  style.textContent = STYLE;
  place.className = "viewer object";
  const parsed = new DOMParser().parseFromString(model.get("_markup"), "text/html");
  place.append(...parsed.body.childNodes);
  root.append(style, place);
  el.append(host);
  const viewer = opened(model.get("_scene"), root, SHADERS);
  if (!viewer) return () => host.remove();
  const part = tiedTo(model, viewer);
  viewer.changed();
  return () => {
    part();
    viewer.close();
    host.remove();
  };
}

export default { render };

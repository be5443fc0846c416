// Read the page's data, and show it.

// A view may be named in the address: #azimuth=30&elevation=20&size=512, in degrees and pixels.
function named(viewer) {
  const asked = new URLSearchParams(location.hash.slice(1));
  for (const key of ["azimuth", "elevation"]) {
    const degrees = Number(asked.get(key));
    if (asked.has(key) && Number.isFinite(degrees))
      viewer.state[key] = degrees * Math.PI / 180;
  }
  const size = Number(asked.get("size"));
  if (size >= 16 && size <= MOST_PIXELS) viewer.fixedSize = Math.round(size);
  viewer.changed();
}

function start() {
  const text = (name) => document.getElementById(name).textContent;
  const scene = JSON.parse(text("scene")), shaders = {};
  for (const name of ["table", "square", "map", "mesh", "sphere", "object"])
    shaders[name] = text(`shader-${name}`);
  photographControls(scene);
  const viewer = opened(scene, document, shaders);
  if (!viewer) return;
  explorer(viewer);
  window.addEventListener("hashchange", () => named(viewer));
  named(viewer);
  viewer.frame();
}

start();

// Read the page's data, and show it; without WebGL2 the still picture stays.

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
  const text = (name) => byId(name).textContent;
  const scene = JSON.parse(text("scene"));
  const canvas = byId("object");
  photographControls(scene);
  let viewer;
  try {
    const shaders = {};
    for (const name of ["table", "square", "map", "mesh", "sphere", "object"])
      shaders[name] = text(`shader-${name}`);
    viewer = new Viewer(scene, canvas, shaders);
  } catch (trouble) {
    byId("without").hidden = false;
    byId("trouble").textContent = `Reason: ${trouble.message}.`;
    document.documentElement.dataset.state = "still";
    return;
  }
  materialControls(viewer);
  lightControls(viewer);
  dragged(viewer);
  explorer(viewer);
  textureControls(viewer);
  canvas.addEventListener("webglcontextlost", () => {
    byId("without").hidden = false;
    byId("trouble").textContent = "The graphics processor stopped. Load the page again.";
  });
  window.addEventListener("hashchange", () => named(viewer));
  new ResizeObserver(() => viewer.changed(false)).observe(canvas);
  byId("still").hidden = true;
  canvas.hidden = false;
  for (const control of document.querySelectorAll("[data-live]")) control.disabled = false;
  named(viewer);
  viewer.frame();
}

start();

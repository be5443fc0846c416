// Open the picture of a page, or of a part of another one; null where it cannot be drawn.

// Show the scene in what the root holds; without WebGL2 the still picture stays, with a word.
function opened(scene, root, shaders) {
  const byId = (name) => root.getElementById(name), canvas = byId("object");
  const refused = (words) => {
    byId("without").hidden = false;
    byId("trouble").textContent = words;
  };
  let viewer;
  try {
    viewer = new Viewer(scene, canvas, shaders);
  } catch (trouble) {
    refused(`Reason: ${trouble.message}.`);
    (root.host || root.documentElement).dataset.state = "still";
    return null;
  }
  materialControls(viewer);
  lightControls(viewer);
  dragged(viewer);
  textureControls(viewer);
  canvas.addEventListener("webglcontextlost", () =>
    refused("The graphics processor stopped. Load the page again."));
  const size = new ResizeObserver(() => viewer.changed(false));
  size.observe(canvas);
  viewer.close = () => {
    size.disconnect();
    viewer.renderer.close();
  };
  byId("still").hidden = true;
  canvas.hidden = false;
  for (const control of viewer.all("[data-live]")) control.disabled = false;
  return viewer;
}

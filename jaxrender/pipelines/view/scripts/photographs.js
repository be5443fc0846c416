// A photograph and its prediction under a wiper, with what may lie over them.

function photographControls(scene) {
  const byId = (id) => document.getElementById(id), choice = byId("photograph-choice");
  if (!choice) return;
  const overlay = byId("overlay-choice"), wiper = byId("wiper"), stage = byId("stage");
  const use = () => {
    const frame = scene.photographs[Number(choice.value)];
    byId("photograph").src = frame.photograph;
    byId("photograph").alt = `Photograph ${frame.name}`;
    byId("prediction").src = frame.predicted;
    byId("prediction").alt = `What the result predicts for ${frame.name}`;
    const over = frame[overlay.value];
    byId("overlay").hidden = !over;
    if (over) byId("overlay").src = over;
    byId("overlay").alt = over ? `${overlay.selectedOptions[0].text} of ${frame.name}` : "";
    for (const legend of document.querySelectorAll("[data-legend]"))
      legend.hidden = legend.dataset.legend !== overlay.value;
  };
  const wipe = () => {
    stage.style.setProperty("--wiper", `${wiper.value}%`);
    wiper.setAttribute("aria-valuetext",
      `${wiper.value} per cent photograph, the rest prediction`);
  };
  choice.addEventListener("change", use);
  overlay.addEventListener("change", use);
  wiper.addEventListener("input", wipe);
  const drag = (event) => {
    if (event.buttons !== 1) return;
    const box = stage.getBoundingClientRect();
    wiper.value = Math.round(100 * (event.clientX - box.left) / box.width);
    wipe();
  };
  stage.addEventListener("pointerdown", drag);
  stage.addEventListener("pointermove", drag);
  use();
  wipe();
}

// The fitted BRDF: lobes in the plane of incidence, and a slice over half and difference angles.

function explorer(viewer) {
  const [angle, lobes, slice] = ["incidence", "lobes", "slice"].map((id) => viewer.byId(id));
  let waiting = false;
  const draw = () => {
    waiting = false;
    const degrees = Number(angle.value);
    viewer.byId("value-incidence").textContent = `${degrees}°`;
    drawLobes(viewer, lobes, degrees);
    drawSlice(viewer, slice);
  };
  const later = () => {
    if (!waiting) { waiting = true; setTimeout(draw, 30); }
  };
  angle.addEventListener("input", later);
  for (const slider of viewer.all("[data-material]"))
    slider.addEventListener("input", later);
  viewer.byId("fitted").addEventListener("click", later);
  // After the first picture of the object.
  setTimeout(draw, 50);
}

function reflectance(viewer, values) {
  return viewer.material.mixed(viewer.state.base, viewer.state.lobe, values);
}

function drawLobes(viewer, canvas, degrees) {
  const context = canvas.getContext("2d"), { width, height } = canvas;
  const style = getComputedStyle(canvas);
  const ink = style.color, [middle, bottom, size] = [width / 2, height - 24, height - 44];
  const radians = degrees * Math.PI / 180;
  const incoming = [-Math.sin(radians), 0, Math.cos(radians)];
  const curve = [];
  for (let k = -178; k <= 178; ++k) {
    const exit = k * Math.PI / 360, outgoing = [Math.sin(exit), 0, Math.cos(exit)];
    const rgb = reflectance(viewer, viewer.material.ofPair(incoming, outgoing));
    curve.push([exit, (rgb[0] + rgb[1] + rgb[2]) / 3]);
  }
  const most = Math.max(...curve.map(([, value]) => value), 1e-9);
  const radius = (value) => size * Math.sqrt(Math.max(value, 0) / most);
  context.clearRect(0, 0, width, height);
  context.lineWidth = 1;
  context.strokeStyle = context.fillStyle = ink;
  context.globalAlpha = 0.3;
  for (const share of [0.25, 0.5, 1]) {
    context.beginPath();
    context.arc(middle, bottom, radius(share * most), Math.PI, 2 * Math.PI);
    context.stroke();
  }
  context.beginPath();
  context.moveTo(middle - size, bottom);
  context.lineTo(middle + size, bottom);
  context.stroke();
  context.globalAlpha = 1;
  context.font = "15px system-ui, sans-serif";
  context.fillText(`outer circle ${shown(most)} per steradian`, 6, 18);
  context.lineWidth = 3;
  context.setLineDash([7, 5]);
  context.beginPath();
  context.moveTo(middle, bottom);
  context.lineTo(middle + size * incoming[0], bottom - size * incoming[2]);
  context.stroke();
  context.setLineDash([]);
  context.strokeStyle = style.getPropertyValue("--accent");
  context.beginPath();
  curve.forEach(([exit, value], k) => {
    const x = middle + radius(value) * Math.sin(exit), y = bottom - radius(value) * Math.cos(exit);
    if (k) context.lineTo(x, y); else context.moveTo(x, y);
  });
  context.closePath();
  context.stroke();
  canvas.setAttribute("aria-label",
    `Reflectance against exit angle for light from ${degrees} degrees; the largest value is `
    + `${shown(most)} per steradian`);
}

// Half angle to the right, difference angle upwards, at an azimuth of 90 degrees.
function drawSlice(viewer, canvas) {
  const context = canvas.getContext("2d"), { width, height } = canvas;
  const picture = context.createImageData(width, height);
  for (let row = 0; row < height; ++row)
    for (let column = 0; column < width; ++column) {
      const half = (column + 0.5) / width * Math.PI / 2;
      const other = (1 - (row + 0.5) / height) * Math.PI / 2;
      const cosine = Math.cos(half) * Math.cos(other), to = 4 * (row * width + column);
      const rgb = reflectance(viewer,
        viewer.material.evaluate(half, Math.cos(other), 0, cosine, cosine));
      rgb.forEach((value, c) => {
        const bright = Math.PI * value / (1 + Math.PI * value) * 1.25;
        picture.data[to + c] = 255 * Math.min(bright, 1) ** (1 / 2.2);
      });
      picture.data[to + 3] = 255;
    }
  context.putImageData(picture, 0, 0);
}

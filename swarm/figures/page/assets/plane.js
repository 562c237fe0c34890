// The plane, as the page looks at it: a camera above, arrows that stand still in the water.

const Plane = {
  Lives, axes: ["x", "y"], camera: { x: 0, y: 0, scale: 20 }, turns: false,
  stage: canvas => new Stage(canvas, data),

  // The camera that sees a box.
  aimed([left, low], [right, high]) {
    const { width, height } = shown[0];
    const scale = Math.min(width / Math.max(1.08 * (right - left) + 1.2, 5), (height - 30) / Math.max(1.08 * (high - low) + 1.2, 5));
    return { x: (left + right) / 2, y: (low + high) / 2, scale };
  },
  ease(wanted, part) {
    const off = wanted.scale / camera.scale;
    if (off < 0.93 || off > 1.4) easing = true; // seldom, and then at once: what is drawn has to be drawn anew
    camera.x += part * (wanted.x - camera.x); camera.y += part * (wanted.y - camera.y);
    if (easing) {
      camera.scale *= (0.97 * off) ** Math.min(1, 2 * part);
      if (Math.abs(0.97 * wanted.scale / camera.scale - 1) < 0.02) { easing = false; stale = true; }
    }
  },
  // The camera of a pane, on whole pixels, so that trails stay sharp when it moves.
  at({ x, y, scale }) {
    const pixel = 1 / (scale * (stage ? stage.ratio : 1));
    return { x: pixel * Math.round(x / pixel), y: pixel * Math.round(y / pixel), scale };
  },
  pan(dx, dy) { camera.x -= dx / camera.scale; camera.y += dy / camera.scale; },
  drag(dx, dy) { Plane.pan(dx, dy); },
  zoomed(pane, scale, at) {
    if (pane && mode === "free") {
      const dx = at[0] - pane.x - pane.width / 2, dy = pane.y + pane.height / 2 - at[1];
      camera.x += dx / camera.scale - dx / scale; camera.y += dy / camera.scale - dy / scale;
    }
    camera.scale = scale;
  },
  // Where on the screen the cell is that was placed last.
  onScreen(pane, cell) {
    let { x, y } = pane.lives;
    if (pane.lives.won(cell, now) && data.egg) {
      const away = Math.atan2(y - data.egg.y, x - data.egg.x);
      x = data.egg.x + data.egg.radius * Math.cos(away); y = data.egg.y + data.egg.radius * Math.sin(away);
    }
    return [pane.x + pane.width / 2 + (x - pane.camera.x) * pane.camera.scale, pane.y + pane.height / 2 - (y - pane.camera.y) * pane.camera.scale];
  },
  over(pen, pane, moment) {
    if ($("gradient").checked) (pane.gradient ??= new Arrows((x, y, at) => slope(pane, x, y, at))).draw(pen, pane, moment, 0.5, theme.css.gradient + "a0");
    if (data.background.flow && $("flow").checked) (Plane.current ??= new Arrows(streaming)).draw(pen, pane, moment, 0, theme.css.flow + "b0");
    drawDisks(pen, pane);
    drawAxes(pen, pane, data.unit, theme);
  },
};

// The disks by which cells push each other apart, where they are larger than heads.
function drawDisks(pen, pane) {
  const { lives, camera, x, y, width, height } = pane, radius = 0.5 * data.contact * camera.scale;
  if (radius <= 0.5 * headsAcross(camera.scale, lives.n)) return;
  pen.beginPath();
  for (let cell = 0; cell < lives.n; cell++) {
    if (lives.over(cell, now) && now < lives.end) continue;
    const [px, py] = onScreen(pane, cell);
    if (px < x - radius || px > x + width + radius || py < y - radius || py > y + height + radius) continue;
    pen.moveTo(px + radius, py);
    pen.arc(px, py, radius, 0, 2 * Math.PI);
  }
  pen.fillStyle = pen.strokeStyle = theme.css.ink; pen.lineWidth = 1;
  pen.globalAlpha = 0.1; pen.fill();
  pen.globalAlpha = 0.55; pen.stroke();
  pen.globalAlpha = 1;
}

// --- fields of arrows ------------------------------------------------------------------------------------------

const unitPlace = (x, y) => { const { low, high } = data.background; return [(x - low[0]) / (high[0] - low[0]), (y - low[1]) / (high[1] - low[1])]; };
function slope(pane, x, y, moment) {
  const { low, high } = data.background, { films } = concentration, film = films[Math.min(pane.index, films.length - 1)];
  const [u, v] = unitPlace(x, y), a = 1.5 / film.size[0], b = 1.5 / film.size[1];
  const [i, j, f] = film.between(moment), at = (p, q) => (1 - f) * sample(film.values, film.size, i, p, q) + f * sample(film.values, film.size, j, p, q);
  return [(at(u + a, v) - at(u - a, v)) / (2 * a * (high[0] - low[0])), (at(u, v + b) - at(u, v - b)) / (2 * b * (high[1] - low[1]))];
}
function streaming(x, y, moment) {
  const { times, size } = data.background.flow, frame = times.length < 2 ? 0 : Math.round(moment / times.at(-1) * (times.length - 1));
  const [u, v] = unitPlace(x, y);
  return currents.map(values => sample(values, size, frame, u, v));
}

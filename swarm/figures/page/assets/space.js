// Space, as the page looks at it: lives along helices, and a camera that goes round what it looks at.

class SpaceLives extends Lives {
  constructor(policy, data) {
    super(policy, data);
    const rates = data.curvatures.map((bend, i) => Math.hypot(bend, data.torsions[i]) * data.speeds[i]);
    this.rate = Math.max(...rates) || 1; // of turning [rad / time]
    this.fine = (this.n > TAILS ? 2 : 1) * FINE_TURN / this.rate; // of trails [time]
    this.fade = Math.min(12 * Math.PI / this.rate, this.fine * MOST_STRANDS / this.n / WINDOWS); // six turns, of many cells less
    this.arc = new Float64Array(20 * this.n);
    this.z = this.tx = this.ty = this.tz = this.nx = this.ny = this.nz = 0; // of the cell that was last asked for
  }

  // Unit vectors at a decision: tangent, normal, binormal.
  frame(at) {
    const w = this.q_ws[at], x = this.q_xs[at], y = this.q_ys[at], z = this.q_zs[at];
    return [[1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
      [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
      [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]];
  }
  numbers(bend) { const twist = this.between(this.data.torsions, bend); return [twist, Math.hypot(bend, twist) || 1e-9]; }
  axisAt(cell, step) {
    const at = cell * this.count + step, bend = this.curvatures[at], [, w] = this.numbers(bend), [, n] = this.frame(at);
    return [this.xs, this.ys, this.zs].map((each, k) => each[at] + n[k] * bend / (w * w));
  }

  // Sets x, y, z, the tangent and the normal: a helix, with what flow and noise added spread evenly.
  place(cell, t) {
    this.find(cell, t);
    const at = cell * this.count + this.step, h = this.arc, k = 20 * cell, s = this.part;
    if (s === 0) {
      const [tangent, normal] = this.frame(at);
      this.x = this.xs[at]; this.y = this.ys[at]; this.z = this.zs[at];
      [this.tx, this.ty, this.tz] = tangent; [this.nx, this.ny, this.nz] = normal;
      return;
    }
    if (this.arcOf[cell] !== this.step) this.begin(cell, at, k);
    const turn = s * h[k + 18], sine = Math.sin(turn), part = 1 - Math.cos(turn), cosine = 1 - part;
    this.x = h[k] + s * (h[k + 3] + h[k + 12]) + sine * h[k + 6] + part * h[k + 9];
    this.y = h[k + 1] + s * (h[k + 4] + h[k + 13]) + sine * h[k + 7] + part * h[k + 10];
    this.z = h[k + 2] + s * (h[k + 5] + h[k + 14]) + sine * h[k + 8] + part * h[k + 11];
    const w = h[k + 19], long = h[k + 18] / w, a = w * cosine, b = w * sine;
    this.tx = h[k + 3] / long + a * h[k + 6] + b * h[k + 9] + s * h[k + 15];
    this.ty = h[k + 4] / long + a * h[k + 7] + b * h[k + 10] + s * h[k + 16];
    this.tz = h[k + 5] / long + a * h[k + 8] + b * h[k + 11] + s * h[k + 17];
    const u = -sine * h[k + 6] + cosine * h[k + 9], v = -sine * h[k + 7] + cosine * h[k + 10], q = -sine * h[k + 8] + cosine * h[k + 11], size = Math.hypot(u, v, q) || 1;
    this.nx = u / size; this.ny = v / size; this.nz = q / size;
  }

  // The helix of an interval: r + s·(along + rest) + sin(s·turn)·across + (1 − cos(s·turn))·inwards; rest of the tangent; turn, w.
  begin(cell, at, k) {
    const h = this.arc, clock = cell * this.stride + this.step, bend = this.curvatures[at + 1], [twist, w] = this.numbers(bend);
    const long = this.speed(bend) * (this.times[clock + 1] - this.times[clock]), turn = w * long, [t, , b] = this.frame(at), [after] = this.frame(at + 1);
    const series = [this.xs, this.ys, this.zs], axis = t.map((each, i) => (twist * each + bend * b[i]) / w);
    const sine = Math.sin(turn), part = 1 - Math.cos(turn);
    for (let i = 0; i < 3; i++) {
      const j = (i + 1) % 3, l = (i + 2) % 3, along = axis[i] * twist / w, across = (t[i] - along) / w, inwards = (axis[j] * t[l] - axis[l] * t[j]) / w;
      h[k + i] = series[i][at]; h[k + 3 + i] = along * long; h[k + 6 + i] = across; h[k + 9 + i] = inwards;
      h[k + 12 + i] = series[i][at + 1] - series[i][at] - along * long - sine * across - part * inwards;
      h[k + 15 + i] = after[i] - along - w * ((1 - part) * across + sine * inwards);
    }
    h[k + 18] = turn; h[k + 19] = w;
    this.arcOf[cell] = this.step;
  }
}

// --- the camera ------------------------------------------------------------------------------------------------

const EYE = 2.2; // how far away the eye is, in widths of what is in view
const SPIN = 0.12; // of the slow rotation [rad / s]
const AXES = ["x", "y", "z"];

// Unit vectors: to the right, up, and towards the eye.
function axesOf({ azimuth, elevation }) {
  const s = Math.sin(azimuth), c = Math.cos(azimuth), v = Math.sin(elevation), u = Math.cos(elevation);
  return [[-s, c, 0], [-c * v, -s * v, u], [c * u, s * u, v]];
}
const eyeOf = ({ camera, width, height }) => EYE * Math.max(width, height) / camera.scale;
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

// What of all water is in view, and its walls on the far side.
function boxOf({ camera }) {
  const { low, high } = data.background, near = axesOf(camera)[2], middle = AXES.map(axis => camera[axis]);
  const least = middle.map((at, k) => Math.max(low[k], at - camera.reach)), most = middle.map((at, k) => Math.min(high[k], at + camera.reach));
  return { low: least, high: most, far: near.map((side, k) => side > 0 ? least[k] : most[k]) };
}

// Where on the screen a place is [pixels of the page]; and how much larger than at the centre.
function project(pane, place) {
  const { camera } = pane, away = [place[0] - camera.x, place[1] - camera.y, place[2] - camera.z], [right, up, near] = axesOf(camera);
  const larger = 1 / Math.max(0.05, 1 - dot(near, away) / eyeOf(pane)), scale = camera.scale * larger;
  return [pane.x + pane.width / 2 + scale * dot(right, away), pane.y + pane.height / 2 - scale * dot(up, away), larger];
}

const Space = {
  Lives: SpaceLives, axes: AXES, turns: true,
  camera: { x: 0, y: 0, z: 0, scale: 20, reach: 5, azimuth: -Math.PI / 3, elevation: 0.35 },
  stage: canvas => new Volume(canvas),
  keys: "Space plays; , and . step. On the picture: dragging and arrows turn, with Shift they move, + and − zoom, n and p follow a cell, Esc lets it go, 0 the swarm, 9 all.",

  aimed(low, high, whole) {
    if (whole) ({ low, high } = data.background);
    else if (data.egg) {
      const { radius } = data.egg;
      low = low.map((each, k) => Math.min(each, data.egg[AXES[k]] - radius)); high = high.map((each, k) => Math.max(each, data.egg[AXES[k]] + radius));
    }
    const sides = high.map((each, k) => each - low[k]), reach = Math.max(0.56 * Math.max(...sides) + 0.4, 1.6);
    const [x, y, z] = low.map((each, k) => (each + high[k]) / 2), scale = Space.fitting(whole ? sides : [2 * reach, 2 * reach, 2 * reach]);
    return { ...camera, x, y, z, scale, reach: whole ? Infinity : reach };
  },
  // The scale at which a box of these sides is seen whole from all around.
  fitting([wide, deep, high]) {
    const { width, height } = shown[0], across = Math.hypot(wide, deep), { elevation } = camera;
    return Math.min(width / (1.22 * across), (height - 40) / (1.2 * (high * Math.cos(elevation) + across * Math.abs(Math.sin(elevation)))));
  },
  ease(wanted, part) {
    for (const key of AXES) camera[key] += part * (wanted[key] - camera[key]);
    camera.reach = Number.isFinite(camera.reach) ? camera.reach * (wanted.reach / camera.reach) ** part : wanted.reach;
    camera.scale *= (wanted.scale / camera.scale) ** part;
    easing = Math.abs(Math.log(wanted.scale / camera.scale)) > 0.01;
  },
  at(camera) { return { ...camera }; },
  turn(passed) { camera.azimuth += SPIN * passed; },
  drag(dx, dy) { camera.azimuth -= 0.008 * dx; camera.elevation = clamp(camera.elevation + 0.006 * dy, -1.5, 1.5); },
  pan(dx, dy) {
    const [right, up] = axesOf(camera), { low, high } = data.background;
    AXES.forEach((axis, k) => { camera[axis] = clamp(camera[axis] + (dy * up[k] - dx * right[k]) / camera.scale, low[k], high[k]); });
  },
  zoomed(pane, scale) { camera.scale = scale; camera.reach = Space.fitting([2, 2, 2]) / scale; },
  onScreen(pane, cell) { const { x, y, z } = pane.lives; return project(pane, [x, y, z]); },
  over(pen, pane, moment) {
    drawBox(pen, pane, data.unit, theme);
    if ($("gradient").checked) drawSlope(pen, pane, moment, theme);
    if (data.background.flow && $("flow").checked) drawStreams(pen, pane, moment, theme);
  },
};

// --- over the stage ----------------------------------------------------------------------------------------------

// Far edges of the box, and numbers along three in front.
function drawBox(pen, pane, unit, theme) {
  const box = boxOf(pane), near = box.far.map((far, k) => far === box.low[k] ? box.high[k] : box.low[k]), axes = axesOf(pane.camera);
  const at = (axis, value, corner) => corner.map((each, k) => k === axis ? value : each), middle = project(pane, box.low.map((each, k) => (each + box.high[k]) / 2));
  const line = (a, b) => { const [p, q] = [project(pane, a), project(pane, b)]; pen.moveTo(p[0], p[1]); pen.lineTo(q[0], q[1]); };
  pen.strokeStyle = theme.css.faint; pen.lineWidth = 1; pen.globalAlpha = 0.55; pen.beginPath();
  for (let axis = 0; axis < 3; axis++) for (const other of [null, ...AXES.keys()]) if (other !== axis) {
    const corner = other === null ? box.far : at(other, near[other], box.far);
    line(at(axis, box.low[axis], corner), at(axis, box.high[axis], corner));
  }
  pen.stroke(); pen.globalAlpha = 1;
  const labels = [], uprights = [at(0, near[0], box.far), at(1, near[1], box.far)];
  const edges = [at(2, box.far[2], near), at(2, box.far[2], near), uprights.reduce((a, b) => dot(axes[0], a) < dot(axes[0], b) ? a : b)];
  pen.font = "11px system-ui, sans-serif"; pen.beginPath();
  edges.forEach((edge, axis) => {
    const first = project(pane, at(axis, box.low[axis], edge)), last = project(pane, at(axis, box.high[axis], edge)), long = Math.hypot(last[0] - first[0], last[1] - first[1]);
    if (long < 40) return;
    const half = [(first[0] + last[0]) / 2 - middle[0], (first[1] + last[1]) / 2 - middle[1]], size = Math.hypot(...half) || 1, out = axis === 2 ? [-1, 0] : [half[0] / size, half[1] / size];
    const span = box.high[axis] - box.low[axis], step = niceStep(span / Math.max(1.5, long / 75)), digits = digitsOf(step);
    for (let i = Math.ceil((box.low[axis] + 0.05 * span) / step); i * step < box.high[axis] - 0.05 * span; i++) {
      const [x, y] = project(pane, at(axis, i * step, edge));
      pen.moveTo(x, y); pen.lineTo(x + 5 * out[0], y + 5 * out[1]);
      labels.push([plain(i * step, digits), x + 16 * out[0], y + 14 * out[1] + 4, "center"]);
    }
    const end = axis === 2 ? project(pane, at(2, box.high[2], edge)) : [(first[0] + last[0]) / 2 + 34 * out[0], (first[1] + last[1]) / 2 + 32 * out[1] + 4];
    labels.push([AXES[axis] + (unit ? " [" + unit + "]" : ""), end[0], end[1] - (axis === 2 ? 8 : 0), "center"]);
  });
  pen.stroke();
  haloed(pen, labels, theme, theme.css.ink);
}

function arrow(pen, x, y, tx, ty, head) {
  const long = Math.hypot(tx - x, ty - y);
  if (long < 2) return;
  const ux = (tx - x) / long, uy = (ty - y) / long, size = Math.min(head, 0.45 * long);
  pen.moveTo(x, y); pen.lineTo(tx, ty);
  for (const side of [-0.5, 0.5]) { pen.moveTo(tx, ty); pen.lineTo(tx - size * ux - side * size * uy, ty - size * uy + side * size * ux); }
}

// Where concentration grows in the middle of what is in view.
function drawSlope(pen, pane, moment, theme) {
  const { low, high } = data.background, film = concentration.films[Math.min(pane.index, concentration.films.length - 1)], [i, j, f] = film.between(moment);
  const middle = AXES.map((axis, k) => (pane.camera[axis] - low[k]) / (high[k] - low[k]));
  const value = at => (1 - f) * trilinear(film.values, film.size, i, at) + f * trilinear(film.values, film.size, j, at);
  const slope = middle.map((each, k) => {
    const step = 1 / (film.size[k] - 1), beside = side => middle.map((one, l) => clamp(l === k ? one + side * step : one, 0, 1)), ends = [beside(-1), beside(1)];
    return (value(ends[1]) - value(ends[0])) / ((ends[1][k] - ends[0][k]) * (high[k] - low[k]));
  }), size = Math.hypot(...slope);
  if (!(size > 0)) return;
  const [right, up] = axesOf(pane.camera), x = pane.x + 34, y = pane.y + 74, dx = 20 * dot(right, slope) / size, dy = -20 * dot(up, slope) / size;
  pen.strokeStyle = theme.css.gradient; pen.lineWidth = 2.2; pen.lineCap = "round"; pen.beginPath();
  arrow(pen, x - dx, y - dy, x + dx, y + dy, 11);
  pen.stroke(); pen.lineCap = "butt";
  pen.font = "13px system-ui, sans-serif";
  haloed(pen, [["∇c", x + 36, y + 5, "center"]], theme, theme.css.gradient);
}

// The flow, where it was kept.
function drawStreams(pen, pane, moment, theme) {
  const { times, size } = data.background.flow, { low, high } = data.background, total = size[0] * size[1] * size[2], box = boxOf(pane);
  const frame = times.length < 2 ? 0 : Math.round(moment / times.at(-1) * (times.length - 1)), found = [];
  let most = 0;
  for (let n = 0; n < total; n++) {
    const index = [n % size[0], Math.floor(n / size[0]) % size[1], Math.floor(n / size[0] / size[1])], place = index.map((each, k) => low[k] + each / (size[k] - 1) * (high[k] - low[k]));
    const flow = currents.map(values => values[frame * total + n]), fast = Math.hypot(...flow);
    if (!(fast > 0) || place.some((each, k) => each < box.low[k] || each > box.high[k])) continue;
    most = Math.max(most, fast);
    found.push([place, flow]);
  }
  const step = 0.3 * Math.max(...high.map((each, k) => (each - low[k]) / (size[k] - 1)));
  pen.strokeStyle = theme.css.flow; pen.globalAlpha = 0.55; pen.lineWidth = 1.2; pen.beginPath();
  for (const [place, flow] of found) {
    const [a, b] = [-1, 1].map(side => project(pane, place.map((each, k) => each + side * step * flow[k] / most)));
    arrow(pen, a[0], a[1], b[0], b[1], 7);
  }
  pen.stroke(); pen.globalAlpha = 1;
}

// A number at a place in [0, 1]³ of a frame of a grid of a size.
function trilinear(values, [across, down, deep], frame, [u, v, w]) {
  const z = w * (deep - 1), layer = Math.min(Math.floor(z), deep - 2), at = each => sample(values, [across, down], frame * deep + each, u, v);
  return at(layer) + (z - layer) * (at(layer + 1) - at(layer));
}

// Over the stage: axes, scale bar, arrows, names, the chosen cell; and the chart of gains.

const niceStep = span => {
  const power = 10 ** Math.floor(Math.log10(span));
  return [5, 2, 1].map(step => step * power).find(step => step <= span * (1 + 1e-9));
};
const digitsOf = step => Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
const signed = (value, digits = 2) => (value < -0.5 * 10 ** -digits ? "−" : "+") + Math.abs(value).toFixed(digits);
const plain = (value, digits) => (value < -0.5 * 10 ** -digits ? "−" : "") + Math.abs(value).toFixed(digits);
const rgb = hex => [1, 3, 5].map(at => parseInt(hex.slice(at, at + 2), 16) / 255);

// A canvas as sharp as the screen.
function sharp(canvas) {
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight, pen = canvas.getContext("2d");
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio); canvas.height = Math.round(height * ratio);
  }
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  return [pen, width, height];
}

// Arrows of a quantity that has a direction, on places that stand still while the camera moves.
class Arrows {
  constructor(vector) { this.vector = vector; this.key = null; }
  draw(pen, pane, moment, shift, colour) {
    const { camera, width, height } = pane, step = 2 ** (Math.round(2 * Math.log2(Math.max(width, height, 520) / camera.scale / 11)) / 2), reach = 0.55 * step;
    const first = axis => Math.floor((camera[axis] - (axis === "x" ? width : height) / 2 / camera.scale) / step) - 1;
    const columns = Math.ceil(width / camera.scale / step) + 3, rows = Math.ceil(height / camera.scale / step) + 3, left = first("x"), low = first("y");
    const key = [step, columns, rows, left, low, moment].join();
    if (key !== this.key) {
      this.key = key;
      this.found = [];
      let most = 0;
      for (let i = 0; i < columns; i++) for (let j = 0; j < rows; j++) {
        const x = (left + i + shift) * step, y = (low + j + shift) * step, [u, v] = this.vector(x, y, moment), size = Math.hypot(u, v);
        if (size > 0) { this.found.push([x, y, u, v]); most = Math.max(most, size); }
      }
      for (const each of this.found) { each[2] *= reach / most; each[3] *= reach / most; }
    }
    pen.fillStyle = colour;
    pen.beginPath();
    for (const [x, y, u, v] of this.found) {
      const px = pane.x + width / 2 + (x - camera.x) * camera.scale, py = pane.y + height / 2 - (y - camera.y) * camera.scale;
      const a = u * camera.scale, b = -v * camera.scale, long = Math.hypot(a, b);
      if (long < 3) continue;
      const head = Math.min(7, 0.45 * long), ux = a / long, uy = b / long, tx = px + a / 2, ty = py + b / 2, nx = -uy, ny = ux;
      const bx = tx - head * ux, by = ty - head * uy, w = 0.42 * head;
      pen.moveTo(tx, ty); pen.lineTo(bx + w * nx, by + w * ny); pen.lineTo(bx + 0.7 * nx, by + 0.7 * ny);
      pen.lineTo(px - a / 2, py - b / 2); pen.lineTo(bx - 0.7 * nx, by - 0.7 * ny); pen.lineTo(bx - w * nx, by - w * ny);
      pen.closePath();
    }
    pen.fill();
  }
}

function drawAxes(pen, pane, unit, theme) {
  const { camera, x: left, y: top, width, height } = pane, step = niceStep(Math.min(width, 560) / camera.scale / 4), digits = digitsOf(step);
  const right = left + width, bottom = top + height, toX = x => left + width / 2 + (x - camera.x) * camera.scale, toY = y => top + height / 2 - (y - camera.y) * camera.scale;
  pen.font = "11px system-ui, sans-serif";
  pen.strokeStyle = theme.css.faint; pen.lineWidth = 1; pen.beginPath();
  const labels = [];
  for (let i = Math.ceil((camera.x - width / 2 / camera.scale) / step); toX(i * step) < right; i++) {
    const at = Math.round(toX(i * step)) + 0.5;
    pen.moveTo(at, bottom); pen.lineTo(at, bottom - 6);
    if (at > left + 44 && at < right - 30) labels.push([plain(i * step, digits), at, bottom - 10, "center"]);
  }
  for (let i = Math.ceil((camera.y - height / 2 / camera.scale) / step); toY(i * step) > top; i++) {
    const at = Math.round(toY(i * step)) + 0.5;
    pen.moveTo(left, at); pen.lineTo(left + 6, at);
    if (at < bottom - 30 && at > top + 40) labels.push([plain(i * step, digits), left + 10, at + 4, "left"]);
  }
  pen.stroke();
  const suffix = unit ? " [" + unit + "]" : "";
  labels.push(["x" + suffix, right - 12, bottom - 10, "right"], ["y" + suffix, left + 10, bottom - 10, "left"]);
  haloed(pen, labels, theme, theme.css.ink);
  const bar = niceStep(width / camera.scale / 5), wide = bar * camera.scale, x0 = right - 18 - wide, y0 = bottom - 38;
  pen.fillStyle = theme.css.veil; pen.fillRect(x0 - 8, y0 - 20, wide + 16, 28);
  pen.fillStyle = theme.css.ink; pen.fillRect(x0, y0, wide, 3);
  pen.textAlign = "center"; pen.fillText(plain(bar, digitsOf(bar)) + (unit ? " " + unit : ""), x0 + wide / 2, y0 - 6);
}
function haloed(pen, labels, theme, colour) {
  pen.lineWidth = 3; pen.strokeStyle = theme.css.veil; pen.fillStyle = colour; pen.lineJoin = "round";
  for (const [text, x, y, align] of labels) { pen.textAlign = align; pen.strokeText(text, x, y); pen.fillText(text, x, y); }
}

// Mean gain of every policy over time, strong up to now; and the limit so far.
function drawChart(canvas, lives, data, now, end, theme) {
  const [pen, width, height] = sharp(canvas), left = 34, bottom = height - 20, right = width - 8, top = 8, limit = data.limit;
  let low = 0, high = 1e-9;
  for (const each of lives) for (const value of each.policy.curve.mean) { low = Math.min(low, value); high = Math.max(high, value); }
  if (limit) high = Math.max(high, ...limit.values);
  const toX = t => left + t / end * (right - left), toY = value => bottom - (value - low) / (high - low) * (bottom - top);
  const step = niceStep((high - low) / 2.5), tick = niceStep(end / 3);
  pen.font = "11px system-ui, sans-serif"; pen.lineWidth = 1; pen.strokeStyle = theme.css.line; pen.fillStyle = theme.css.faint;
  pen.textAlign = "right";
  for (let i = Math.ceil(low / step); i * step <= high; i++) {
    const y = Math.round(toY(i * step)) + 0.5;
    pen.beginPath(); pen.moveTo(left, y); pen.lineTo(right, y); pen.stroke();
    pen.fillText(plain(i * step, digitsOf(step)), left - 5, y + 4);
  }
  pen.textAlign = "center";
  for (let i = 0; i * tick <= end * (1 + 1e-9); i++) pen.fillText(plain(i * tick, digitsOf(tick)), Math.min(toX(i * tick), right - 6), height - 5);
  const line = (times, values, until, colour, alpha, thick, dash) => {
    pen.save(); pen.beginPath(); pen.rect(left, 0, toX(until) - left, height); pen.clip();
    pen.strokeStyle = colour; pen.globalAlpha = alpha; pen.lineWidth = thick; pen.setLineDash(dash); pen.lineJoin = "round";
    pen.beginPath();
    values.forEach((value, i) => pen.lineTo(toX(times(i)), toY(value)));
    pen.stroke(); pen.restore();
  };
  for (const each of [...lives].reverse()) {
    const { mean, end: own } = each.policy.curve, times = i => i / (mean.length - 1) * own, dash = DASHES[each.index % DASHES.length];
    line(times, mean, end, theme.policy(each.index), 0.3, 1.5, dash);
    line(times, mean, now, theme.policy(each.index), 1, 2.2, dash);
  }
  if (limit) {
    const flat = limit.times.length < 2, values = flat ? [limit.values[0], limit.values[0]] : limit.values, times = i => flat ? i * end : limit.times[i];
    line(times, values, end, theme.css.ink, 0.35, 1.2, [5, 4]);
    if (!flat) line(times, values, now, theme.css.ink, 1, 1.2, [5, 4]);
  }
  pen.strokeStyle = theme.css.faint; pen.lineWidth = 1;
  pen.beginPath(); pen.moveTo(toX(now), top); pen.lineTo(toX(now), bottom); pen.stroke();
}
const DASHES = [[], [7, 3], [2, 2.5], [8, 3, 2, 3], [4, 2], [1, 3]];

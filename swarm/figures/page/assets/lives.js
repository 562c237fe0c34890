"use strict";
// Lives: series of 16 bits -> where a cell is at any time, along the arc that it swims.

const bytes = text => {
  const raw = atob(text), out = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) out[i] = raw.charCodeAt(i);
  return out;
};
const numbers = ({ low, step, data }) => Float32Array.from(new Uint16Array(bytes(data).buffer),
  code => code ? low + (code - 1) * step : NaN);
const FADE = 3; // in which a trail falls to 1/e of its light [time]
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);
const wrapped = angle => angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI));

class Lives {
  constructor(policy, data) {
    Object.assign(this, { policy, data, n: policy.shape[0], count: policy.shape[1] });
    for (const key in policy.series) this[key + "s"] = numbers(policy.series[key]);
    this.stride = this.times.length > this.count || this.n === 1 ? this.count : 0; // 0: one clock for all
    this.last = new Int32Array(this.n).fill(this.count - 1);
    this.end = 0;
    this.fade = FADE;
    for (let cell = 0; cell < this.n; cell++) {
      while (this.last[cell] > 0 && Number.isNaN(this.times[cell * this.stride + this.last[cell]])) this.last[cell]--;
      this.end = Math.max(this.end, this.times[cell * this.stride + this.last[cell]]);
    }
    this.cursor = new Int32Array(this.n);
    this.arcOf = new Int32Array(this.n).fill(-1); // the interval whose arc is kept, and the arc
    this.arc = new Float64Array(6 * this.n);
    this.x = this.y = this.angle = this.sine = this.cosine = this.step = this.part = 0; // of the cell that was last asked for
  }

  // What goes with a curvature, of what goes with each action.
  between(values, bend) {
    const { curvatures } = this.data;
    let i = 0;
    while (i < curvatures.length - 2 && bend > curvatures[i + 1]) i++;
    const part = clamp((bend - curvatures[i]) / (curvatures[i + 1] - curvatures[i]), 0, 1);
    return values[i] + part * (values[i + 1] - values[i]);
  }
  speed(bend) { return this.between(this.data.speeds, bend); }

  // What a cell turned around.
  axisAt(cell, step) {
    const at = cell * this.count + step, bend = this.curvatures[at], angle = this.headings[at];
    return [this.xs[at] - Math.sin(angle) / bend, this.ys[at] + Math.cos(angle) / bend];
  }

  over(cell, t) { return t >= this.times[cell * this.stride + this.last[cell]]; }
  won(cell, t) { const { won, arrival } = this.policy; return Boolean(won && won[cell] && arrival[cell] <= t + 1e-6); }

  find(cell, t) {
    const from = cell * this.stride, last = this.last[cell], times = this.times;
    if (t >= times[from + last]) { this.step = last; this.part = 0; return; }
    let at = this.cursor[cell];
    if (times[from + at] > t) at = 0;
    while (at < last - 1 && times[from + at + 1] <= t) at++;
    this.cursor[cell] = this.step = at;
    this.part = Math.max(0, (t - times[from + at]) / (times[from + at + 1] - times[from + at]));
  }

  // Sets x, y and angle: an arc of the curvature that was swum, with what flow and noise added spread evenly.
  place(cell, t) {
    this.find(cell, t);
    const at = cell * this.count + this.step, arc = this.arc, k = 6 * cell, s = this.part;
    const angle = this.headings[at];
    if (s === 0) {
      this.x = this.xs[at]; this.y = this.ys[at]; this.angle = angle; this.sine = Math.sin(angle); this.cosine = Math.cos(angle);
      return;
    }
    if (this.arcOf[cell] !== this.step) {
      const clock = cell * this.stride + this.step, bend = this.curvatures[at + 1];
      const length = this.speed(bend) * (this.times[clock + 1] - this.times[clock]);
      const turn = bend * length + wrapped(this.headings[at + 1] - angle - bend * length);
      const radius = length / (Math.abs(turn) < 1e-6 ? 1e-6 : turn);
      this.arcOf[cell] = this.step;
      arc.set([turn, radius, Math.sin(angle), Math.cos(angle)], k);
      arc[k + 4] = this.xs[at + 1] - this.xs[at] - radius * (Math.sin(angle + turn) - arc[k + 2]);
      arc[k + 5] = this.ys[at + 1] - this.ys[at] - radius * (arc[k + 3] - Math.cos(angle + turn));
    }
    this.angle = angle + s * arc[k];
    this.sine = Math.sin(this.angle); this.cosine = Math.cos(this.angle);
    this.x = this.xs[at] + arc[k + 1] * (this.sine - arc[k + 2]) + s * arc[k + 4];
    this.y = this.ys[at] + arc[k + 1] * (arc[k + 3] - this.cosine) + s * arc[k + 5];
  }

  // A series at the time that was last asked for.
  value(series, cell) {
    const at = cell * this.count + this.step;
    return this.part ? series[at] + this.part * (series[at + 1] - series[at]) : series[at];
  }
  gain(cell) { return this.value(this.concentrations, cell) - this.concentrations[cell * this.count]; }
  bend(cell) { return this.curvatures[cell * this.count + this.step + (this.part > 0 ? 1 : 0)]; }

  // The mean gain of all cells, of those too that are not shown.
  mean(t) {
    const { mean, end } = this.policy.curve, at = clamp(t / end, 0, 1) * (mean.length - 1), i = Math.min(Math.floor(at), mean.length - 2);
    return mean[i] + (at - i) * (mean[i + 1] - mean[i]);
  }

  // Arrivals so far, and whether the egg has closed.
  race(t) {
    const { arrival, won } = this.policy;
    if (!arrival) return null;
    const came = arrival.filter((time, cell) => time !== null && won[cell]).sort((a, b) => a - b), needed = this.data.needed;
    const closes = came.length >= needed ? came[needed - 1] + this.data.delay : Infinity;
    return { came: came.filter(time => time <= t + 1e-6).length, closed: t >= closes - 1e-6 };
  }
}

// Water: values on a grid over time, for the eye (a texture) and for arrows (numbers).
class Film {
  constructor({ times, size, values }, least, most) {
    Object.assign(this, { times, size, frames: times.length, values: numbers(values) });
    const span = most - least || 1, texels = this.values.length, half = new Uint16Array(2 * texels), toHalf = THREE.DataUtils.toHalfFloat;
    for (let i = 0; i < texels; i++) {
      const known = !Number.isNaN(this.values[i]);
      half[2 * i] = known ? toHalf((this.values[i] - least) / span) : 0;
      half[2 * i + 1] = known ? 15360 : 0; // 1 in 16 bits
    }
    const texture = this.texture = new THREE.DataArrayTexture(half, size[0], size[1], this.frames * (size[2] ?? 1)); // layer by layer in space
    Object.assign(texture, { format: THREE.RGFormat, type: THREE.HalfFloatType, minFilter: THREE.LinearFilter, magFilter: THREE.LinearFilter, needsUpdate: true });
  }
  // The two frames around a time, and the part of the second.
  between(t) {
    let i = 0;
    while (i < this.frames - 2 && this.times[i + 1] <= t) i++;
    if (this.frames < 2) return [0, 0, 0];
    return [i, i + 1, clamp((t - this.times[i]) / (this.times[i + 1] - this.times[i]), 0, 1)];
  }
}

// A number (NaN outside) at a place (u, v) in [0, 1]², of a frame of a grid of a size.
function sample(values, [across, down], frame, u, v) {
  if (!(u >= 0 && u <= 1 && v >= 0 && v <= 1)) return NaN;
  const a = u * (across - 1), b = v * (down - 1), i = Math.min(Math.floor(a), across - 2), j = Math.min(Math.floor(b), down - 2);
  const at = frame * across * down + j * across + i, f = a - i, g = b - j;
  return (1 - g) * ((1 - f) * values[at] + f * values[at + 1]) + g * ((1 - f) * values[at + across] + f * values[at + across + 1]);
}

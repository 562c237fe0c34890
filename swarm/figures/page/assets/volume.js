// The stage in space: walls of water, the egg, trails, flagella and heads, drawn anew with every picture.

const MOST_STRANDS = 20000; // of all trails
const WINDOWS = 3; // time that a trail reaches back, in those in which it falls to 1/e
const FINE_TURN = 0.25; // of a helix, parts of a trail [rad]
const MOST_WAYS = 30000; // parts of the ways of all cells
const BEAT = 0.12; // length of a flagellum [time]

const LENS = `
uniform vec3 centre, right, up, near; // unit vectors, \`near\` towards the eye
uniform vec3 lens; // half the width and height of the picture, and how far away the eye is [length]
vec4 seen(vec3 place) {
  vec3 p = place - centre;
  float d = dot(near, p);
  return vec4(dot(right, p) / lens.x, dot(up, p) / lens.y, -0.02 * d / lens.x, 1.0 - d / lens.z);
}
float haze(float w) { return clamp(1.0 - 1.3 * (w - 1.0), 0.3, 1.0); }`;

// Walls of the box in view: the far ones alone.
const WALL = `${LENS}
in vec3 place;
out vec3 at;
void main() { at = place; gl_Position = seen(place); gl_Position.z = 0.99 * gl_Position.w; }`;
const BRICK = `${TINTED}
uniform vec3 low, high, size;
in vec3 at;
out vec4 colour;
vec2 found(vec3 q, float moment) {
  float z = q.z * (size.z - 1.0), lower = min(floor(z), size.z - 2.0), layer = moment * size.z + lower;
  vec2 flat_place = (q.xy * (size.xy - 1.0) + 0.5) / size.xy;
  return mix(texture(film, vec3(flat_place, layer)).rg, texture(film, vec3(flat_place, layer + 1.0)).rg, z - lower);
}
void main() {
  vec3 q = clamp((at - low) / (high - low), 0.0, 1.0);
  vec2 held = found(q, frame.x);
  if (frame.z > 0.0) held = mix(held, found(q, frame.y), frame.z);
  colour = vec4(tinted(held, 1.0), 1.0);
}`;

// The egg: a sphere, lit from above the eye.
const BALL = `${LENS}
uniform vec4 egg;
in vec3 place; // on the unit sphere
out vec3 normal;
void main() { normal = place; gl_Position = seen(egg.xyz + egg.w * place); }`;
const SHELL = `
precision highp float;
uniform vec3 right, up, near, shell;
in vec3 normal;
out vec4 colour;
void main() {
  vec3 n = vec3(dot(normal, right), dot(normal, up), dot(normal, near));
  float light = dot(normalize(n), normalize(vec3(-0.35, 0.75, 0.8))), rim = smoothstep(0.55, 0.0, n.z);
  vec3 c = mix(shell * vec3(0.55, 0.45, 0.5), shell, smoothstep(-0.5, 0.75, light));
  colour = vec4(mix(c, mix(shell, vec3(1.0), 0.5), 0.5 * rim), 1.0);
}`;

// Parts of trails: four corners each, fainter the longer ago.
const STRANDS = `${LENS}
uniform vec2 half_size; // [pixels]
uniform float reach, now, fade; // [pixels], [time]
uniform vec2 ground; // height of the floor, and whether shadows on it are drawn
uniform vec4 floor_box; // its low and high corner
in vec4 start; // and when [time]
in vec3 finish;
in vec4 tint;
out vec4 shade;
out vec3 away;
void main() {
  vec3 from = start.xyz, to = finish;
  bool off = any(lessThan(to.xy, floor_box.xy)) || any(greaterThan(to.xy, floor_box.zw));
  if (ground.y > 0.0) from.z = to.z = ground.x;
  vec4 a = seen(from), b = seen(to);
  float age = (now - start.w) / fade, light = tint.a * exp(-age) * smoothstep(3.0, 2.2, age);
  shade = vec4(0.0); away = vec3(0.0);
  gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  if (ground.y > 0.0 && off || a.w < 0.05 || b.w < 0.05 || light < 0.02 || age < -1e-3) return;
  vec2 p = a.xy / a.w * half_size, q = b.xy / b.w * half_size;
  float span = length(q - p);
  vec2 along = span > 1e-6 ? (q - p) / span : vec2(1.0, 0.0), across = vec2(-along.y, along.x);
  bool first = (gl_VertexID & 1) == 0;
  float v = (gl_VertexID & 2) == 0 ? -reach : reach;
  shade = vec4(tint.rgb, light * haze(0.5 * (a.w + b.w)));
  away = vec3(first ? 0.0 : span, v, span);
  gl_Position = vec4(((first ? p : q) + across * v) / half_size, first ? a.z / a.w : b.z / b.w, 1.0);
}`;

const BODIES = `${LENS}
uniform float across; // [pixels of the screen]
in vec3 place;
in vec3 heading;
in vec4 tint;
out vec4 shade;
out vec3 ahead; // its direction on the screen, and how much of its length is seen
flat out float wide;
void main() {
  gl_Position = seen(place);
  wide = across / gl_Position.w;
  gl_PointSize = wide + 2.0;
  shade = vec4(tint.rgb, tint.a * mix(1.0, haze(gl_Position.w), 0.6));
  vec2 way = vec2(dot(right, heading), dot(up, heading));
  float far = length(way);
  ahead = vec3(far > 1e-4 ? way / far : vec2(1.0, 0.0), mix(0.62, 1.0, far));
}`;
const BODY = `
precision highp float;
uniform vec3 rim;
in vec4 shade;
in vec3 ahead;
flat in float wide;
out vec4 colour;
void main() {
  vec2 p = (gl_PointCoord - 0.5) * vec2(1.0, -1.0) * (wide + 2.0), q = vec2(dot(p, ahead.xy) / ahead.z, dot(p, vec2(-ahead.y, ahead.x)) / 0.62);
  float d = length(q) - 0.5 * wide, a = 1.0 - smoothstep(-0.4, 1.0, d);
  if (a < 0.02) discard;
  colour = vec4(mix(shade.rgb, rim, smoothstep(-1.9, -0.9, d)), 1.0) * a * shade.a;
}`;
const TRACKS = `${LENS}
in vec3 place;
void main() { gl_Position = seen(place); }`;

// Parts of trails of which the oldest make room for the newest.
class Ring {
  constructor(most) {
    this.most = most;
    this.geometry = new THREE.BufferGeometry();
    const index = new Uint32Array(6 * most);
    for (let i = 0; i < most; i++) index.set([4 * i, 4 * i + 1, 4 * i + 2, 4 * i + 2, 4 * i + 1, 4 * i + 3], 6 * i);
    const held = (array, items, normal) => new THREE.BufferAttribute(array, items, normal).setUsage(THREE.DynamicDrawUsage);
    this.geometry.setAttribute("start", this.start = held(new Float32Array(16 * most), 4));
    this.geometry.setAttribute("finish", this.finish = held(new Float32Array(12 * most), 3));
    this.geometry.setAttribute("tint", this.tint = held(new Uint8Array(16 * most), 4, true));
    this.geometry.setIndex(new THREE.BufferAttribute(index, 1));
    this.clear();
  }
  clear() { this.next = this.filled = this.fresh = 0; }
  add(from, to, colour, a, t) {
    const s = this.start.array, f = this.finish.array, c = this.tint.array;
    for (let k = 4 * this.next, last = k + 4; k < last; k++) {
      s[4 * k] = from[0]; s[4 * k + 1] = from[1]; s[4 * k + 2] = from[2]; s[4 * k + 3] = t;
      f[3 * k] = to[0]; f[3 * k + 1] = to[1]; f[3 * k + 2] = to[2];
      c[4 * k] = 255 * colour[0]; c[4 * k + 1] = 255 * colour[1]; c[4 * k + 2] = 255 * colour[2]; c[4 * k + 3] = 255 * a;
    }
    this.next = (this.next + 1) % this.most;
    this.filled = Math.min(this.filled + 1, this.most);
    this.fresh = Math.min(this.fresh + 1, this.most);
  }
  send() {
    if (!this.fresh) return;
    const first = (this.next - this.fresh + this.most) % this.most, spans = first + this.fresh <= this.most ? [[first, this.fresh]] : [[first, this.most - first], [0, first + this.fresh - this.most]];
    for (const each of [this.start, this.finish, this.tint]) {
      each.clearUpdateRanges();
      for (const [from, count] of spans) each.addUpdateRange(4 * each.itemSize * from, 4 * each.itemSize * count);
      each.needsUpdate = true;
    }
    this.geometry.setDrawRange(0, 6 * this.filled);
    this.fresh = 0;
  }
}

class Volume extends Panes {
  constructor(canvas) {
    super(canvas, { antialias: policies[0].n <= TAILS, depth: true });
    this.lens = Object.fromEntries(["centre", "right", "up", "near", "lens"].map(name => [name, { value: vector() }]));
    const made = (vertex, fragment, uniforms, blending, depth = {}) => {
      const look = material(vertex, fragment, uniforms, blending);
      Object.assign(look.uniforms, this.lens); // one view for all
      return Object.assign(look, { depthTest: true, ...depth });
    };
    this.wall = made(WALL, BRICK, { ...tinting(), low: vector(), high: vector(), size: vector() }, null, { depthTest: false });
    this.ball = made(BALL, SHELL, { egg: vector(4), shell: vector() }, null, { depthWrite: true });
    const strands = { half_size: vector(2), width: vector(2), reach: 4, now: 0, fade: 1, ground: vector(2), floor_box: vector(4) };
    this.trails = made(STRANDS, GLOW, strands, "over");
    this.shadows = made(STRANDS, GLOW, { ...strands, half_size: vector(2), width: vector(2), ground: vector(2), floor_box: vector(4) }, "over");
    this.heads = made(BODIES, BODY, { across: 10, rim: vector() }, "over", { depthWrite: true });
    this.ways = made(TRACKS, WAY, { tint: vector(4) }, "over");
    this.box = new THREE.BufferGeometry();
    this.box.setAttribute("place", this.corners = new THREE.BufferAttribute(new Float32Array(36), 3).setUsage(THREE.DynamicDrawUsage));
    this.box.setIndex(new THREE.BufferAttribute(Uint16Array.from([0, 4, 8].flatMap(k => [k, k + 1, k + 2, k + 2, k + 1, k + 3])), 1));
    const sides = material => Object.assign(material, { side: 2 }); // both: corners run either way
    this.walls = drawn(THREE.Mesh, this.box, sides(this.wall));
    this.egg = drawn(THREE.Mesh, sphere(48, 24), sides(this.ball));
    for (const each of [this.trails, this.shadows]) sides(each);
  }

  show(shown, ratio) {
    for (const pane of this.panes) for (const each of [pane.ring, pane.tails]) each?.geometry.dispose();
    this.begin(ratio);
    this.panes = shown.map(({ lives, index, x, y, width, height }) => {
      const pane = { lives, index, x, y, width, height, camera: null, now: null, shown: 0, before: new Float32Array(3 * lives.n) };
      const { fine: part, fade } = lives, reach = WINDOWS * fade;
      Object.assign(pane, { part, reach, ring: new Ring(Math.ceil(1.2 * lives.n * (reach / part + 2))) });
      pane.trails = drawn(THREE.Mesh, pane.ring.geometry, this.trails);
      if (lives.n <= TAILS) {
        pane.shadows = drawn(THREE.Mesh, pane.ring.geometry, this.shadows);
        pane.tails = new Ring(TAIL_PARTS * lives.n);
        pane.flagella = drawn(THREE.Mesh, pane.tails.geometry, this.trails);
      }
      this.addCells(pane, 3, this.heads);
      if (lives.n <= WITH_WAYS) this.addWays(pane, 3, Infinity, Math.ceil(lives.n * lives.count / MOST_WAYS));
      return pane;
    });
  }

  // Bring the trails of a pane to a time; anew where time went back or far ahead, or `anew` is asked for.
  follow(pane, now, camera, tint, anew) {
    const { lives, ring, before, part, reach } = pane, again = anew || pane.now === null || now < pane.now || now > pane.now + 0.5 * reach;
    pane.camera = camera;
    if (!again && now - pane.now < part && now > pane.now) return;
    const from = again ? Math.max(0, now - reach) : pane.now, parts = Math.max(0, Math.floor((now - from) / part + 1e-6));
    if (again) {
      ring.clear();
      for (let cell = 0; cell < lives.n; cell++) { lives.place(cell, from); before.set([lives.x, lives.y, lives.z], 3 * cell); }
    }
    const a = [0, 0, 0], b = [0, 0, 0];
    for (let i = 1; i <= parts; i++) for (let cell = 0; cell < lives.n; cell++) {
      const t = from + i * part, k = 3 * cell;
      lives.place(cell, t);
      a[0] = before[k]; a[1] = before[k + 1]; a[2] = before[k + 2];
      b[0] = before[k] = lives.x; b[1] = before[k + 1] = lives.y; b[2] = before[k + 2] = lives.z;
      if (a[0] !== b[0] || a[1] !== b[1] || a[2] !== b[2]) ring.add(a, b, tint(cell), 1, t);
    }
    pane.now = from + parts * part;
    ring.send();
  }

  aim(pane, box) {
    const { camera } = pane, axes = axesOf(camera), set = (name, values) => this.lens[name].value.set(...values);
    set("centre", [camera.x, camera.y, camera.z]);
    set("right", axes[0]); set("up", axes[1]); set("near", axes[2]);
    set("lens", [pane.width / 2 / camera.scale, pane.height / 2 / camera.scale, eyeOf(pane)]);
    box.far.forEach((_, axis) => { // the three walls, each by four corners
      const [u, v] = [0, 1, 2].filter(k => k !== axis);
      for (let i = 0; i < 4; i++) {
        const place = [];
        place[axis] = box.far[axis];
        place[u] = i & 1 ? box.high[u] : box.low[u]; place[v] = i & 2 ? box.high[v] : box.low[v];
        this.corners.array.set(place, 12 * axis + 3 * i);
      }
    });
    this.corners.needsUpdate = true;
  }

  draw(pane, { layer, now, theme, headTint, ways }) {
    const { renderer, ratio } = this, { lives } = pane, box = boxOf(pane);
    this.enter(pane);
    renderer.setClearColor((r => (r[0] * 255 << 16) + (r[1] * 255 << 8) + r[2] * 255)(theme.paper), 1);
    renderer.clear(true, true, false);
    this.aim(pane, box);
    const { low, high } = data.background, film = layer.films[Math.min(pane.index, layer.films.length - 1)];
    this.wall.uniforms.low.value.set(...low); this.wall.uniforms.high.value.set(...high);
    colourWater(this.wall, layer, film, film.between(now), theme);
    renderer.render(this.walls, this.eye);
    if (data.egg) {
      this.ball.uniforms.egg.value.set(data.egg.x, data.egg.y, data.egg.z, data.egg.radius);
      this.ball.uniforms.shell.value.set(...theme.egg);
      renderer.render(this.egg, this.eye);
    }
    if (ways && pane.lines) {
      while (pane.shown < pane.swum.length && pane.swum[pane.shown] <= now) pane.shown++;
      while (pane.shown > 0 && pane.swum[pane.shown - 1] > now) pane.shown--;
      pane.ways.setDrawRange(0, 2 * pane.shown);
      this.ways.uniforms.tint.value.set(...theme.ways(pane.index), theme.dark ? 0.45 : 0.5);
      renderer.render(pane.lines, this.eye);
    }
    const many = lives.n > TAILS, strand = (look, thick, glow, reach, ground, fade) => {
      const to = look.uniforms;
      to.half_size.value.set(pane.width * ratio / 2, pane.height * ratio / 2);
      to.width.value.set(thick * ratio, glow); to.reach.value = reach * ratio; to.ground.value.set(...ground);
      to.now.value = now; to.fade.value = fade;
    }, { fade } = lives;
    if (pane.shadows && box.far[2] === box.low[2]) {
      this.shadows.uniforms.floor_box.value.set(box.low[0], box.low[1], box.high[0], box.high[1]);
      strand(this.shadows, 0.4, 0.25, 2.5, [box.low[2], 1], 0.5 * fade);
      renderer.render(pane.shadows, this.eye);
    }
    strand(this.trails, many ? 0.5 : 0.8, many ? 0 : 0.3, many ? 1.5 : 4.5, [0, 0], fade);
    renderer.render(pane.trails, this.eye);
    if (pane.tails && pane.camera.scale > 12) this.drawTails(pane, now, headTint, strand);
    this.drawHeads(pane, now, theme, headTint);
    renderer.setScissorTest(false);
  }

  drawTails(pane, now, headTint, strand) {
    const { lives, tails } = pane, a = [0, 0, 0], b = [0, 0, 0];
    tails.clear();
    beating(lives, now, BEAT, (cell, wave, first, light) => {
      b[0] = lives.x + wave * lives.nx; b[1] = lives.y + wave * lives.ny; b[2] = lives.z + wave * lives.nz;
      if (!first) tails.add(a, b, headTint(cell, false), light, now);
      a[0] = b[0]; a[1] = b[1]; a[2] = b[2];
    });
    tails.send();
    strand(this.trails, 0.7, 0, 2.5, [0, 0], 1);
    this.renderer.render(pane.flagella, this.eye);
  }

  drawHeads(pane, now, theme, headTint) {
    const { lives, points } = pane, { place, heading, tint } = points.attributes;
    for (let cell = 0; cell < lives.n; cell++) {
      lives.place(cell, now);
      const i = 3 * cell, j = 4 * cell, colour = headTint(cell, false);
      place.array[i] = lives.x; place.array[i + 1] = lives.y; place.array[i + 2] = lives.z;
      heading.array[i] = lives.tx; heading.array[i + 1] = lives.ty; heading.array[i + 2] = lives.tz;
      tint.array[j] = colour[0]; tint.array[j + 1] = colour[1]; tint.array[j + 2] = colour[2]; tint.array[j + 3] = lives.over(cell, now) && now < lives.end ? 0.55 : 1;
    }
    for (const each of [place, heading, tint]) each.needsUpdate = true;
    const many = lives.n > TAILS;
    this.heads.uniforms.across.value = this.ratio * clamp(0.2 * pane.camera.scale, many ? 5 : 6.5, many ? 8 : 13);
    this.heads.uniforms.rim.value.set(...theme.rim);
    this.renderer.render(pane.dots, this.eye);
  }
}

function sphere(around, down) {
  const place = [], index = [];
  for (let i = 0; i <= down; i++) for (let j = 0; j <= around; j++) {
    const a = Math.PI * i / down, b = 2 * Math.PI * j / around;
    place.push(Math.sin(a) * Math.cos(b), Math.sin(a) * Math.sin(b), Math.cos(a));
    if (i < down && j < around) { const k = i * (around + 1) + j; index.push(k, k + 1, k + around + 1, k + around + 1, k + 1, k + around + 2); }
  }
  const made = new THREE.BufferGeometry();
  made.setAttribute("place", new THREE.BufferAttribute(new Float32Array(place), 3));
  made.setIndex(new THREE.BufferAttribute(Uint16Array.from(index), 1));
  return made;
}

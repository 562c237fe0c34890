// The stage: one picture for each policy that is shown, by three.js; trails live in a framebuffer that fades.

const FINE = 0.06; // parts of a trail [time]
const MOST_PARTS = 90000; // of all trails, when they are drawn anew
const MARGIN = 56; // by which framebuffers reach beyond the picture, so that a camera that moves needs no new ones [pixels]
const LEAST = 0.06; // by which trails are made fainter at once, at least
const MANY = 2000; // cells, whose trails and heads are drawn more simply
const TAILS = 400, TAIL = 0.42, TAIL_PARTS = 10; // at most so many cells show flagella; their length [time]
const WITH_WAYS = 1000, SMOOTH = 3; // at most so many cells show the ways of their centres; decisions to each side

const headsAcross = (scale, cells) => clamp(0.22 * scale, cells > MANY ? 3 : 7, cells > MANY ? 9 : 13); // [pixels of the page]

function material(vertex, fragment, uniforms, blending) {
  const made = new THREE.RawShaderMaterial({
    glslVersion: THREE.GLSL3, vertexShader: vertex, fragmentShader: fragment, depthTest: false, depthWrite: false,
    uniforms: Object.fromEntries(Object.entries(uniforms).map(([name, value]) => [name, { value }])),
  });
  if (!blending) made.blending = THREE.NoBlending;
  else Object.assign(made, { transparent: true, blending: THREE.CustomBlending, blendSrc: blending === "fade" ? THREE.ZeroFactor : THREE.OneFactor,
    blendEquation: blending === "most" ? THREE.MaxEquation : THREE.AddEquation,
    blendDst: { most: THREE.OneFactor, over: THREE.OneMinusSrcAlphaFactor, fade: THREE.SrcAlphaFactor }[blending] });
  return made;
}
function drawn(Kind, geometry, look) {
  const object = new Kind(geometry, look), scene = new THREE.Scene();
  object.frustumCulled = false;
  scene.add(object);
  return scene;
}

// Lines that change with every picture: four corners each, which software draws much faster than instances.
class Strands {
  constructor() {
    this.geometry = new THREE.BufferGeometry();
    this.room(1024);
    this.count = 0;
  }
  room(most) {
    const ends = new Float32Array(16 * most), tint = new Uint8Array(16 * most), index = new Uint32Array(6 * most);
    if (this.ends) { ends.set(this.ends.array); tint.set(this.tint.array); }
    for (let i = 0; i < most; i++) index.set([4 * i, 4 * i + 1, 4 * i + 2, 4 * i + 2, 4 * i + 1, 4 * i + 3], 6 * i);
    this.geometry.dispose();
    this.geometry.setAttribute("ends", this.ends = new THREE.BufferAttribute(ends, 4).setUsage(THREE.DynamicDrawUsage));
    this.geometry.setAttribute("tint", this.tint = new THREE.BufferAttribute(tint, 4, true).setUsage(THREE.DynamicDrawUsage));
    this.geometry.setIndex(new THREE.BufferAttribute(index, 1));
    this.most = most;
  }
  add(x0, y0, x1, y1, colour, a) {
    if (this.count === this.most) this.room(2 * this.most);
    const e = this.ends.array, t = this.tint.array, r = 255 * colour[0], g = 255 * colour[1], b = 255 * colour[2];
    a *= 255;
    for (let k = 16 * this.count++, last = k + 16; k < last; k += 4) {
      e[k] = x0; e[k + 1] = y0; e[k + 2] = x1; e[k + 3] = y1; t[k] = r; t[k + 1] = g; t[k + 2] = b; t[k + 3] = a;
    }
  }
  // Hand them over to be drawn, and begin anew; how many there were.
  sent() {
    const { count } = this;
    this.count = 0;
    if (!count) return 0;
    for (const each of [this.ends, this.tint]) { each.clearUpdateRanges(); each.addUpdateRange(0, 16 * count); each.needsUpdate = true; }
    this.geometry.setDrawRange(0, 6 * count);
    return count;
  }
}

const vector = (n = 3) => n === 3 ? new THREE.Vector3() : n === 2 ? new THREE.Vector2() : new THREE.Vector4();
const tinting = () => ({ film: null, frame: vector(), levels: vector(2), ramp: Array.from({ length: 5 }, () => vector()), paper: vector(), line: vector(), contrast: 0 });
function colourWater({ uniforms: water }, layer, film, between, theme) {
  water.film.value = film.texture;
  water.frame.value.set(...between);
  water.size.value.set(...film.size);
  water.levels.value.set((layer.most - layer.least) / layer.step, layer.least / layer.step);
  layer.ramps[theme.dark ? 1 : 0].forEach((hex, i) => water.ramp.value[i].set(...rgb(hex)));
  water.paper.value.set(...theme.paper); water.line.value.set(...theme.ink);
  water.contrast.value = theme.dark ? 0.28 : 0.22;
}

// Flagella that beat: for all their parts, how far they are bent aside there, whether they begin, and their light.
function beating(lives, now, long, part) {
  for (let cell = 0; cell < lives.n; cell++) for (let i = 0; i <= TAIL_PARTS && !lives.over(cell, now); i++) {
    const back = i / TAIL_PARTS;
    lives.place(cell, Math.max(0, now - long * back));
    part(cell, 0.04 * Math.min(1, 2.2 * back) * Math.sin(2 * Math.PI * (1.3 * back - 2.1 * now + 0.38 * cell)), i === 0, 0.95 - 0.75 * back);
  }
}

// What the stages of plane and space share: a canvas in panes, each with heads and the ways of what cells turn around.
class Panes {
  constructor(canvas, kind) {
    this.canvas = canvas;
    this.renderer = new THREE.WebGLRenderer({ canvas, alpha: false, stencil: false, powerPreference: "high-performance", ...kind });
    this.renderer.autoClear = false;
    this.eye = new THREE.Camera();
    this.panes = [];
  }

  // Make room for other panes, at so many pixels for one of the page.
  begin(ratio) {
    for (const pane of this.panes) { pane.points.dispose(); pane.ways?.dispose(); }
    this.ratio = ratio;
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(this.canvas.parentElement.clientWidth, this.canvas.parentElement.clientHeight, false);
  }

  addCells(pane, axes, look) {
    const { n } = pane.lives;
    pane.points = new THREE.BufferGeometry();
    for (const [name, items] of [["place", axes], ["heading", axes], ["tint", 4]])
      pane.points.setAttribute(name, new THREE.BufferAttribute(new Float32Array(items * n), items).setUsage(THREE.DynamicDrawUsage));
    pane.points.setDrawRange(0, n);
    pane.dots = drawn(THREE.Points, pane.points, look);
  }

  // Means over neighbours, which take out single turns; none where they jump `far`.
  addWays(pane, axes, far, every = 1) {
    const { lives } = pane, found = [];
    for (let cell = 0; cell < lives.n; cell++) {
      const centres = Array.from({ length: lives.last[cell] + 1 }, (_, step) => lives.axisAt(cell, step));
      let last = null;
      for (let step = SMOOTH; step < centres.length - SMOOTH; step += every) {
        const near = centres.slice(step - SMOOTH, step + SMOOTH + 1), mean = centres[0].map((_, k) => near.reduce((sum, each) => sum + each[k], 0) / near.length);
        if (last && Math.hypot(...mean.map((at, k) => at - last[k])) < far) found.push([lives.times[cell * lives.stride + step], ...last, ...mean]);
        last = mean;
      }
    }
    found.sort((a, b) => a[0] - b[0]);
    pane.swum = found.map(each => each[0]);
    pane.ways = new THREE.BufferGeometry();
    pane.ways.setAttribute("place", new THREE.BufferAttribute(new Float32Array(found.flatMap(each => each.slice(1))), axes));
    pane.lines = drawn(THREE.LineSegments, pane.ways, this.ways);
  }

  // Draw into a pane alone; how far above the canvas' lower edge it begins.
  enter(pane) {
    const low = this.canvas.parentElement.clientHeight - pane.y - pane.height;
    for (const set of ["setViewport", "setScissor"]) this.renderer[set](pane.x, low, pane.width, pane.height);
    this.renderer.setScissorTest(true);
    return low;
  }
}

class Stage extends Panes {
  constructor(canvas, data) {
    super(canvas, { antialias: false, depth: false });
    this.data = data;
    const context = this.renderer.getContext();
    this.smooth = Boolean(context.getExtension("EXT_color_buffer_float") || context.getExtension("EXT_color_buffer_half_float"));
    const whole = new THREE.BufferGeometry();
    whole.setAttribute("corner", new THREE.BufferAttribute(new Float32Array([-1, -1, 3, -1, -1, 3]), 2));
    whole.setDrawRange(0, 3);
    const { low, high } = data.background;
    this.fading = material(WHOLE, FADING, { left: 1 }, "fade");
    this.moving = material(WHOLE, MOVING, { old: null, move: vector() });
    this.over = material(WHOLE, OVER, { water: null, trails: null, shift: vector(4), cover: vector(2) });
    this.water = material(WHOLE, WATER, {
      ...tinting(), view: vector(4), box: new THREE.Vector4(...low, ...high), egg: new THREE.Vector4(0, 0, 0, 0), size: vector(2), shell: vector(), pixel: 1,
    });
    const lines = { view: vector(4), half_size: vector(2), width: vector(2), reach: 4 };
    this.trails = material(LINES, GLOW, lines, "most");
    this.tails = material(LINES, GLOW, { ...lines, view: vector(4), half_size: vector(2), width: vector(2) }, "over");
    this.heads = material(HEADS, HEAD, { view: vector(4), across: 10, rim: vector() }, "over");
    this.specks = material(HEADS, SPECK, { view: vector(4), across: 4 }, "over");
    this.ways = material(WAYS, WAY, { view: vector(4), tint: vector(4) }, "over");
    this.strands = new Strands();
    this.flagella = new Strands();
    this.scenes = Object.fromEntries(["fading", "moving", "over", "water"].map(name => [name, drawn(THREE.Mesh, whole, this[name])]));
    Object.assign(this.scenes, { trails: drawn(THREE.Mesh, this.strands.geometry, this.trails), tails: drawn(THREE.Mesh, this.flagella.geometry, this.tails) });
  }

  // Show these lives, each in a rectangle of the canvas [pixels of the page].
  show(shown, ratio) {
    for (const pane of this.panes) for (const target of [...pane.targets, pane.sea]) target.dispose();
    this.begin(ratio);
    this.panes = shown.map(({ lives, index, x, y, width, height }) => {
      const size = [Math.max(1, Math.round(width * ratio)), Math.max(1, Math.round(height * ratio))];
      const pane = { lives, index, x, y, width, height, size, camera: null, now: null, anchor: null, seen: "", faded: 1, turn: 0, until: [], drawn: 0, drawnAt: 0, shore: null, room: size.map(each => each + 2 * MARGIN) };
      pane.smooth = this.smooth && lives.n <= MANY; // 16 bits cost three times as much where there is no graphics card
      const target = type => new THREE.WebGLRenderTarget(...pane.room, { type, depthBuffer: false, generateMipmaps: false });
      pane.targets = [0, 1].map(() => target(pane.smooth ? THREE.HalfFloatType : THREE.UnsignedByteType));
      pane.sea = target(THREE.UnsignedByteType);
      this.addCells(pane, 2, lives.n > MANY ? this.specks : this.heads);
      pane.before = new Float32Array(2 * lives.n); // where trails end
      if (lives.n <= WITH_WAYS) this.addWays(pane, 2, 0.25 * (this.data.background.high[0] - this.data.background.low[0]));
      return pane;
    });
  }

  // The trails of every cell of a group from one time to another, by parts; fainter the longer ago.
  strand(pane, from, to, part, tint, group = 0, groups = 1) {
    const { lives, before } = pane, far = 0.3 * (this.data.background.high[0] - this.data.background.low[0]), parts = Math.max(1, Math.ceil((to - from) / part - 1e-6));
    for (let cell = group; cell < lives.n; cell += groups) {
      const colour = tint(cell);
      let x = before[2 * cell], y = before[2 * cell + 1];
      for (let i = 1; i <= parts; i++) {
        const t = from + (to - from) * i / parts;
        lives.place(cell, t);
        const still = lives.x === x && lives.y === y;
        if (!still && !lives.won(cell, t) && Math.abs(lives.x - x) + Math.abs(lives.y - y) < far)
          this.strands.add(x, y, lives.x, lives.y, colour, Math.exp(-(to - t) / FADE));
        x = lives.x; y = lives.y;
      }
      before[2 * cell] = x; before[2 * cell + 1] = y;
    }
  }

  // Bring the trails of a pane to a time; anew where time went back or far ahead, or `anew` is asked for.
  follow(pane, now, camera, tint, anew) {
    const { lives } = pane, wait = pane.now === null ? Infinity : now - pane.now, again = anew || wait < 0 || wait > 4 || !pane.anchor;
    pane.camera = camera;
    if (again) {
      const from = Math.max(0, now - 4 * FADE), part = Math.max(FINE, (now - from) * lives.n / MOST_PARTS);
      for (let cell = 0; cell < lives.n; cell++) { lives.place(cell, from); pane.before[2 * cell] = lives.x; pane.before[2 * cell + 1] = lives.y; }
      pane.anchor = camera;
      pane.faded = 1;
      this.renderer.setRenderTarget(pane.targets[0]);
      this.renderer.setClearColor(0, 0);
      this.renderer.clear(true, false, false);
      if (now > from) this.strand(pane, from, now, part, tint);
      pane.until = Array(lives.n > MANY ? 4 : 1).fill(now);
    } else {
      this.reach(pane);
      pane.faded *= Math.exp(-wait / FADE);
      if (pane.faded < 1 - LEAST) {
        this.fading.uniforms.left.value = pane.faded;
        pane.faded = 1;
        this.renderer.setRenderTarget(pane.targets[0]);
        this.renderer.render(this.scenes.fading, this.eye);
      }
    }
    const groups = pane.until.length, group = pane.turn = (pane.turn + 1) % groups; // of many cells, a part with each picture
    if (now > pane.until[group]) this.strand(pane, pane.until[group], now, groups > 1 ? 0.3 : FINE, tint, group, groups);
    pane.until[group] = pane.now = now;
    if (this.strands.sent()) {
      this.renderer.setRenderTarget(pane.targets[0]);
      this.aim(this.trails, pane, pane.anchor, pane.room);
      this.trails.uniforms.width.value.set(0.8 * this.ratio, 0.3);
      this.trails.uniforms.reach.value = (lives.n > MANY ? 2 : 5) * this.ratio;
      this.renderer.render(this.scenes.trails, this.eye);
    }
    this.renderer.setRenderTarget(null);
  }

  // Where the picture lies in a framebuffer around an anchor [pixels]; none where it is not whole in there.
  shift(pane, anchor) {
    const { camera } = pane, scale = camera.scale * this.ratio;
    const found = [(camera.x - anchor.x) * scale, (camera.y - anchor.y) * scale].map(each => MARGIN + Math.round(each));
    return camera.scale === anchor.scale && found.every(each => each >= 0 && each <= 2 * MARGIN) ? found : null;
  }

  // Move the trails to where the picture is, if it is about to leave them.
  reach(pane) {
    if (this.shift(pane, pane.anchor)) return;
    const { anchor: old, camera, room, targets } = pane, scale = old.scale * this.ratio;
    this.moving.uniforms.move.value.set(old.scale / camera.scale, (camera.x - old.x) * scale / room[0], (camera.y - old.y) * scale / room[1]);
    this.moving.uniforms.old.value = targets[0].texture;
    targets.reverse();
    this.renderer.setRenderTarget(targets[0]);
    this.renderer.render(this.scenes.moving, this.eye);
    pane.anchor = camera;
  }

  aim(look, pane, camera = pane.camera, size = pane.size) {
    const scale = camera.scale * this.ratio;
    look.uniforms.view.value.set(camera.x, camera.y, size[0] / 2 / scale, size[1] / 2 / scale);
    if (look.uniforms.half_size) look.uniforms.half_size.value.set(size[0] / 2, size[1] / 2);
  }

  // The water of a pane, where it is not what it was.
  flood(pane, { layer, now, theme, closed, ways }) {
    const { data } = this, film = layer.films[Math.min(pane.index, layer.films.length - 1)], between = film.between(now);
    between[2] = Math.round(4 * between[2]) / 4; // water is dear where there is no graphics card
    const seen = [layer.what, theme.dark, closed, ways, ...between].join(), back = pane.drawnAt > now;
    pane.drawnAt = now;
    if (seen === pane.seen && !back && this.shift(pane, pane.shore)) return;
    Object.assign(pane, { seen, shore: pane.camera, drawn: 0 });
    const water = this.water.uniforms;
    this.aim(this.water, pane, pane.camera, pane.room);
    colourWater(this.water, layer, film, between, theme);
    water.shell.value.set(...theme.egg);
    water.pixel.value = 1 / (pane.camera.scale * this.ratio);
    if (data.egg) water.egg.value.set(data.egg.x, data.egg.y, data.egg.radius, closed ? 2 : 1);
    this.renderer.setRenderTarget(pane.sea);
    this.renderer.render(this.scenes.water, this.eye);
    this.renderer.setRenderTarget(null);
  }

  // The ways as far as they have come since, on the water.
  walk(pane, { now, theme }) {
    const from = pane.drawn;
    while (pane.drawn < pane.swum.length && pane.swum[pane.drawn] <= now) pane.drawn++;
    if (pane.drawn === from) return;
    pane.ways.setDrawRange(2 * from, 2 * (pane.drawn - from));
    this.aim(this.ways, pane, pane.shore, pane.room);
    this.ways.uniforms.tint.value.set(...theme.ways(pane.index), (theme.dark ? 0.5 : 0.55) * (this.data.teams ? 0.5 : 1));
    this.renderer.setRenderTarget(pane.sea);
    this.renderer.render(pane.lines, this.eye);
    this.renderer.setRenderTarget(null);
  }

  // A pane: its water, ways, trails, flagella and heads.
  draw(pane, seen) {
    const { renderer, ratio } = this, { lives, camera } = pane, { now, theme, headTint, ways } = seen;
    this.flood(pane, seen);
    if (ways && pane.lines) this.walk(pane, seen);
    const bottom = Math.floor(this.enter(pane) * ratio), left = Math.floor(pane.x * ratio);
    const over = this.over.uniforms, [x, y] = this.shift(pane, pane.shore), [u, v] = this.shift(pane, pane.anchor);
    over.water.value = pane.sea.texture;
    over.trails.value = pane.targets[0].texture;
    over.shift.value.set(x - left, y - bottom, u - left, v - bottom);
    over.cover.value.set(theme.dark ? 0.35 : 1, pane.smooth ? 0 : 0.5 / LEAST / 255);
    renderer.render(this.scenes.over, this.eye);
    if (lives.n <= TAILS && camera.scale > 6) this.drawTails(pane, now, theme, headTint);
    this.drawHeads(pane, now, theme, headTint);
    renderer.setScissorTest(false);
  }

  drawTails(pane, now, theme, headTint) {
    const { lives } = pane;
    let x = 0, y = 0;
    beating(lives, now, TAIL, (cell, wave, first, light) => {
      const px = lives.x - lives.sine * wave, py = lives.y + lives.cosine * wave;
      if (!first) this.flagella.add(x, y, px, py, headTint(cell, false), light);
      [x, y] = [px, py];
    });
    if (!this.flagella.sent()) return;
    this.aim(this.tails, pane);
    this.tails.uniforms.width.value.set(0.7 * this.ratio, 0);
    this.tails.uniforms.reach.value = 2.5 * this.ratio;
    this.renderer.render(this.scenes.tails, this.eye);
  }

  drawHeads(pane, now, theme, headTint) {
    const { lives, points } = pane, { place, heading, tint } = points.attributes, egg = this.data.egg;
    for (let cell = 0; cell < lives.n; cell++) {
      lives.place(cell, now);
      const won = lives.won(cell, now), i = 2 * cell, j = 4 * cell;
      let { x, y, cosine, sine } = lives;
      if (won && egg) { // at the egg, towards its middle
        const far = Math.hypot(x - egg.x, y - egg.y) || 1;
        cosine = (egg.x - x) / far; sine = (egg.y - y) / far;
        x = egg.x - egg.radius * cosine; y = egg.y - egg.radius * sine;
      }
      place.array[i] = x; place.array[i + 1] = y; heading.array[i] = cosine; heading.array[i + 1] = sine;
      const colour = headTint(cell, won), rest = !won && lives.over(cell, now) && now < lives.end;
      tint.array[j] = colour[0]; tint.array[j + 1] = colour[1]; tint.array[j + 2] = colour[2]; tint.array[j + 3] = rest ? 0.55 : 1;
    }
    for (const each of [place, heading, tint]) each.needsUpdate = true;
    const look = lives.n > MANY ? this.specks : this.heads;
    look.uniforms.across.value = this.ratio * headsAcross(pane.camera.scale, lives.n);
    this.heads.uniforms.rim.value.set(...theme.rim);
    this.aim(look, pane);
    this.renderer.render(pane.dots, this.eye);
  }
}

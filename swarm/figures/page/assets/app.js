// The page: what is shown, the clock, the camera, and everything that a reader can do.

const $ = id => document.getElementById(id);
const asked = new URLSearchParams(location.hash.slice(1));
const view = data.torsions ? Space : Plane;
const policies = data.policies.map((policy, index) => Object.assign(new view.Lives(policy, data), { index }));
const teams = data.teams, layers = data.background.layers, end = Math.max(...policies.map(lives => lives.end));
const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;
let now = 0, playing = false, before = null, chosen = null, hovered = null, mode = asked.get("view") === "whole" ? "whole" : "swarm", camera = view.camera, easing = false, stale = true;
let turning = view.turns && !calm && !asked.has("t") && !asked.has("turn");
let stage = null, shown = [], theme, layer, tints = {}, readAt = -Infinity, drawnFor = "";

$("title").textContent = document.title = data.title;
for (const each of layers) {
  each.step = niceStep((each.most - each.least || 1) / 8);
  $("layer").add(new Option(each.what));
}
for (const { policy } of policies) { $("policy").add(new Option(policy.label)); $("beside").add(new Option(policy.label)); }
$("beside").add(new Option("nothing"));
const single = policies.length < 2;
$("first").hidden = $("second").hidden = single;
$("beside").selectedIndex = single ? 1 : asked.has("beside") ? clamp(Number(asked.get("beside")) || 0, 0, policies.length) : 1;
if (teams) { $("colour").prepend(new Option("team", "team")); $("colour").value = "team"; }
$("hasflow").hidden = !data.background.flow;
$("share").textContent = data.limit ? data.limit.times.length > 1 ? "of the limit" : "of the final limit" : "";
for (const each of [0.5, 1, 2, 4, 8, 16, 32]) $("speed").add(new Option(each + "×", each));
$("speed").value = [1, 2, 4, 8, 16].find(each => end / each <= 45) || 32;
const few = policies[0].n <= 200;
$("ways").checked = few;
$("ways").parentElement.hidden = policies[0].n > WITH_WAYS;
const [some, all] = data.cells;
$("note").textContent = (some < all ? "The first " + some + " of " + all + " cells are drawn, which keeps the page small; means are of all. " : "")
  + "Trails fade to 1/e in " + Number(policies[0].fade.toFixed(1)) + " units of time.";

// --- colours ---------------------------------------------------------------------------------------------------

function setTheme(dark) {
  document.documentElement.dataset.theme = dark ? "dark" : "light";
  const css = getComputedStyle(document.documentElement), of = name => css.getPropertyValue("--" + name).trim();
  const policyColours = data.policies.map(policy => policy.colours[dark ? 1 : 0]);
  theme = {
    dark, paper: rgb(of("paper")), ink: rgb(of("ink")), rim: rgb(dark ? "#05080f" : "#ffffff"), egg: rgb(dark ? "#fadbbd" : "#f0b98a"),
    head: rgb(dark ? "#ffffff" : "#1b2532"), gold: rgb(dark ? "#ffcc6b" : "#b35c00"), policy: index => policyColours[index], ways: index => rgb(teams ? of("ink") : policyColours[index]),
    css: Object.fromEntries(["ink", "faint", "line", "veil", "gradient", "flow"].map(name => [name, of(name)])),
    // both are read by brightness alone, and differ from the water
    ramp: (dark ? ["#5e4fa2", "#b5499b", "#f26d5b", "#fdbb5b", "#fcffa4"] : ["#e08214", "#c2453f", "#8c2981", "#4b1d6b", "#140e36"]).map(rgb),
  };
  tints = {};
  stale = true;
}
const dark = asked.has("theme") ? asked.get("theme") === "dark" : null, prefers = matchMedia("(prefers-color-scheme: light)");
setTheme(dark ?? !prefers.matches);
prefers.onchange = () => { setTheme(!prefers.matches); $("layer").onchange(); };
$("theme").onclick = () => { setTheme(!theme.dark); $("layer").onchange(); };

function onRamp(part) {
  const at = clamp(part, 0, 1) * 4, i = Math.min(Math.floor(at), 3), f = at - i;
  return theme.ramp[i].map((low, k) => low + f * (theme.ramp[i + 1][k] - low));
}
const table = () => tints.ramp ??= Array.from({ length: 64 }, (_, i) => onRamp(i / 63));
const gains = data.policies.flatMap(policy => policy.gain), least = Math.min(0, ...range(gains)), most = Math.max(range(gains)[1], least + 1e-9);
function range(values) { let low = Infinity, high = -Infinity; for (const value of values) { if (value < low) low = value; if (value > high) high = value; } return [low, high]; }
const bends = () => tints.bends ??= (pairs => [Math.min(...pairs.map(pair => pair[0])), Math.max(...pairs.map(pair => pair[1]))])(policies.map(lives => range(lives.curvatures)));
const team = cell => (tints.teams ??= teams.colours.map(pair => rgb(pair[theme.dark ? 1 : 0])))[teams.cells[cell]];
function tint(lives, cell) {
  const kind = $("colour").value;
  if (kind === "team") return team(cell);
  if (kind === "policy") return (tints.own ??= policies.map(each => rgb(theme.policy(each.index))))[lives.index];
  const [low, high] = kind === "curvature" ? bends() : [least, most];
  const value = kind === "end" ? lives.policy.gain[cell] : kind === "now" ? lives.gain(cell) : lives.bend(cell);
  return table()[Math.round(63 * clamp((value - low) / (high - low || 1), 0, 1)) || 0];
}
const headTint = lives => (cell, won) => $("colour").value === "policy" ? won ? theme.gold : theme.head : tint(lives, cell);
const trailTint = lives => cell => { if ($("colour").value !== "policy") lives.find(cell, now); return tint(lives, cell); };

// --- what is shown, and where ----------------------------------------------------------------------------------

function arrange() {
  const box = $("stage"), width = box.clientWidth, height = box.clientHeight, chosenOnes = [$("policy").selectedIndex, $("beside").selectedIndex].slice(0, single ? 1 : 2);
  const kept = chosenOnes.filter((index, i) => index >= 0 && index < policies.length && (i === 0 || index !== chosenOnes[0]));
  const across = width >= height, gap = kept.length > 1 ? 2 : 0, n = kept.length;
  shown = kept.map((index, i) => across
    ? { index, lives: policies[index], x: i * Math.round((width + gap) / n), y: 0, width: Math.round((width - (n - 1) * gap) / n), height }
    : { index, lives: policies[index], x: 0, y: i * Math.round((height + gap) / n), width, height: Math.round((height - (n - 1) * gap) / n) });
  if (stage) {
    stage.show(shown, Math.min(window.devicePixelRatio || 1, 2));
    shown = stage.panes;
  }
  $("stage").setAttribute("aria-label", some + " cells, " + shown.map(pane => pane.lives.policy.label).join(" beside "));
  const wanted = aimed(mode === "whole");
  if (mode === "swarm" || mode === "whole") camera = wanted;
  stale = true;
}
// Low and high corner of all paths, or of the cells that are alive.
function extent(panes, whole) {
  const { axes } = view, low = axes.map(() => Infinity), high = axes.map(() => -Infinity);
  for (const { lives } of panes) {
    if (whole) axes.forEach((axis, k) => {
      const [least, most] = range(lives[axis + "s"]);
      low[k] = Math.min(low[k], least); high[k] = Math.max(high[k], most);
    });
    else for (let pass = 0; pass < 2 && low[0] === Infinity; pass++) for (let cell = 0; cell < lives.n; cell++) {
      if (!pass && lives.over(cell, now) && now < lives.end) continue;
      lives.place(cell, now);
      for (let k = 0; k < axes.length; k++) { const value = lives[axes[k]]; if (value < low[k]) low[k] = value; if (value > high[k]) high[k] = value; }
    }
  }
  return [low, high];
}
function aimed(whole) {
  const boxes = whole ? [extent(shown, true)] : shown.map(pane => extent([pane], false));
  return view.aimed(view.axes.map((_, k) => Math.min(...boxes.map(([low]) => low[k]))), view.axes.map((_, k) => Math.max(...boxes.map(([, high]) => high[k]))), whole);
}
function moveCamera(passed) {
  if (turning) view.turn(passed);
  if (mode === "swarm") view.ease(aimed(false), 1 - Math.exp(-2.2 * passed));
}
function cameraOf(pane) {
  if (mode !== "cell" || chosen === null) return view.at(camera);
  pane.lives.place(chosen, now);
  return view.at({ ...camera, ...Object.fromEntries(view.axes.map(axis => [axis, pane.lives[axis]])) });
}

const concentration = layers.find(each => each.what === "concentration"), streams = data.background.flow;
const currents = streams ? view.axes.map(axis => numbers(streams[axis])) : null;

// --- drawing ---------------------------------------------------------------------------------------------------

function draw(passed) {
  moveCamera(passed);
  const [pen] = sharp($("over")), race = policies.map(lives => lives.race(now)), still = concentration.films[0].frames < 2 && !(streams && streams.times.length > 1);
  const moment = still ? 0 : Math.round(now / end * 200) / 200 * end;
  for (const pane of shown) {
    const at = cameraOf(pane);
    if (stage) {
      stage.follow(pane, now, at, trailTint(pane.lives), stale);
      stage.draw(pane, { layer, now, theme, headTint: headTint(pane.lives), ways: $("ways").checked, closed: race[pane.index]?.closed });
    }
    pane.camera = at;
    pen.save(); pen.beginPath(); pen.rect(pane.x, pane.y, pane.width, pane.height); pen.clip();
    view.over(pen, pane, moment);
    drawName(pen, pane);
    pen.restore();
  }
  if (shown.length > 1) {
    const last = shown[1];
    pen.fillStyle = theme.css.line;
    pen.fillRect(last.x && last.x - 2, last.y && last.y - 2, last.x ? 2 : last.width, last.x ? last.height : 2);
  }
  stale = false;
  const stamp = performance.now();
  if (stamp - readAt > 90 || !playing) { readAt = stamp; read(race); }
}
function drawName(pen, pane) {
  const { policy } = pane.lives, name = teams ? teams.names.join(" against ") : policy.label;
  pen.font = "600 15px system-ui, sans-serif";
  const own = $("colour").value === "policy";
  if (own) {
    pen.fillStyle = theme.policy(pane.index); pen.strokeStyle = theme.css.veil; pen.lineWidth = 2;
    pen.beginPath(); pen.arc(pane.x + 20, pane.y + 20, 6, 0, 2 * Math.PI); pen.stroke(); pen.fill();
  }
  haloed(pen, [[name, pane.x + (own ? 33 : 14), pane.y + 25, "left"]], theme, theme.css.ink);
  const at = hovered ?? chosen;
  for (const cell of new Set([at, chosen])) if (cell !== null && cell < pane.lives.n) {
    const [x, y] = onScreen(pane, cell);
    pen.strokeStyle = theme.css.ink; pen.lineWidth = 1.5; pen.setLineDash(cell === chosen ? [] : [3, 3]);
    pen.beginPath(); pen.arc(x, y, 12, 0, 2 * Math.PI); pen.stroke(); pen.setLineDash([]);
  }
}
function onScreen(pane, cell) {
  pane.lives.place(cell, now);
  return view.onScreen(pane, cell);
}

// --- numbers ---------------------------------------------------------------------------------------------------

function limitNow() {
  if (!data.limit) return null;
  const { times, values } = data.limit;
  if (times.length < 2) return values[0];
  let i = 0;
  while (i < times.length - 2 && times[i + 1] <= now) i++;
  return values[i] + clamp((now - times[i]) / (times[i + 1] - times[i]), 0, 1) * (values[i + 1] - values[i]);
}
const rows = policies.map(lives => {
  const row = $("gains").tBodies[0].insertRow(), name = row.insertCell();
  name.innerHTML = '<svg class="mark" aria-hidden="true"><line x1="0" x2="26" y1="4" y2="4" stroke-width="2.4"/></svg>';
  name.append(lives.policy.label);
  const line = name.querySelector("line");
  line.setAttribute("stroke-dasharray", DASHES[lives.index % DASHES.length].join(" "));
  return { line, gain: row.insertCell(), share: row.insertCell() };
});
let limitRow = null;
if (data.limit) {
  const row = $("gains").tBodies[0].insertRow();
  row.insertCell().innerHTML = '<svg class="mark" aria-hidden="true"><line x1="0" x2="26" y1="4" y2="4" stroke="currentColor" stroke-width="1.5" stroke-dasharray="5 4"/></svg>' + (data.limit.times.length > 1 ? "limit so far" : "limit of a life");
  limitRow = row.insertCell();
  row.insertCell();
}
function read(race) {
  const first = shown[0].lives, limit = limitNow();
  $("clock").textContent = "t = " + now.toFixed(1) + " of " + end.toFixed(0);
  $("mean").textContent = "mean gain " + plain(first.mean(now), 2) + (shown.length > 1 ? " beside " + plain(shown[1].lives.mean(now), 2) : "");
  const came = race[first.index];
  $("arrivals").textContent = data.needed && came ? came.came + " arrived, " + data.needed + " needed" + (came.closed ? "; the egg is closed" : "") : "";
  policies.forEach((lives, i) => {
    rows[i].line.setAttribute("stroke", theme.policy(i));
    rows[i].gain.textContent = signed(lives.mean(now));
    rows[i].share.textContent = limit > 1e-6 && now > 0.5 ? plain(100 * lives.mean(now) / limit, 0) + "%" : "";
  });
  if (limitRow) limitRow.textContent = signed(limit);
  $("time").value = Math.round(1000 * now / end);
  $("time").setAttribute("aria-valuetext", "time " + now.toFixed(1));
  drawChart($("chart"), policies, data, now, end, theme);
  if (teams) $("teams").replaceChildren(...teams.names.map((name, i) => {
    const entry = document.createElement("span"), dot = document.createElement("i");
    dot.style.background = teams.colours[i][theme.dark ? 1 : 0];
    let wins = 0;
    for (let cell = 0; cell < first.n; cell++) if (teams.cells[cell] === i && first.won(cell, now)) wins++;
    entry.append(dot, name + (first.policy.won ? ": " + wins : ""));
    return entry;
  }));
  $("card").hidden = chosen === null;
  if (chosen !== null) {
    $("who").textContent = "cell " + chosen + (teams ? ", " + teams.names[teams.cells[chosen]] : "");
    const facts = shown.map(pane => factsOf(pane.lives, chosen));
    $("facts").tBodies[0].replaceChildren(...Object.keys(facts[0]).map(key => {
      const row = document.createElement("tr");
      row.insertCell().textContent = key;
      for (const each of facts) row.insertCell().textContent = each[key];
      return row;
    }));
  }
}
function factsOf(lives, cell) {
  lives.place(cell, now);
  const found = {};
  if (shown.length > 1) found["policy"] = lives.policy.label;
  found["gain"] = signed(lives.gain(cell)); found["final gain"] = signed(lives.policy.gain[cell]);
  found["curvature"] = lives.bend(cell).toFixed(2);
  if (data.torsions) found["torsion"] = lives.between(data.torsions, lives.bend(cell)).toFixed(2);
  found["place"] = view.axes.map(axis => plain(lives[axis], 1)).join(", ");
  if (lives.eatens) found["eaten"] = lives.value(lives.eatens, cell).toPrecision(3);
  if (lives.policy.won) found["arrived"] = lives.won(cell, now) ? "t = " + lives.policy.arrival[cell].toFixed(2) : "no";
  return found;
}

// --- the clock -------------------------------------------------------------------------------------------------

let queued = false;
function queue() { if (!queued) { queued = true; requestAnimationFrame(tick); } }
function tick(stamp) {
  queued = false;
  const passed = before === null ? 0 : Math.min(0.25, (stamp - before) / 1000);
  before = stamp;
  if (playing) {
    now += passed * Number($("speed").value);
    if (now >= end) { now = end; play(false); }
  }
  draw(passed);
  if (playing || easing || turning) queue(); else before = null;
}
function play(on) {
  playing = on;
  $("play").textContent = on ? "Pause" : now >= end ? "Replay" : "Play";
  if (on) before = null;
  queue();
}
$("play").onclick = () => { if (!playing && now >= end) now = 0; play(!playing); };
function seek(time) { now = clamp(time, 0, end); if (!playing) $("play").textContent = now >= end ? "Replay" : "Play"; queue(); }
$("time").oninput = () => seek(end * $("time").value / 1000);
for (const id of ["policy", "beside"]) $(id).onchange = () => { arrange(); queue(); };
for (const id of ["gradient", "flow", "ways"]) $(id).onchange = queue;
$("layer").onchange = () => {
  layer = layers[Math.max(0, $("layer").selectedIndex)];
  const digits = digitsOf(layer.step), ramp = layer.ramps[theme.dark ? 1 : 0];
  $("least").textContent = plain(layer.least, digits); $("most").textContent = plain(layer.most, digits);
  $("waterbar").style.background = "linear-gradient(90deg," + ramp.join() + ")";
  $("colour").onchange();
};
$("colour").onchange = () => {
  const kind = $("colour").value, scaled = kind !== "policy" && kind !== "team", [lowest, highest] = scaled ? kind === "curvature" ? bends() : [least, most] : [0, 0];
  $("cells").style.display = scaled ? "" : "none";
  $("lowest").textContent = plain(lowest, 1); $("highest").textContent = plain(highest, 1);
  $("cellbar").style.background = "linear-gradient(90deg," + theme.ramp.map(each => "rgb(" + each.map(part => Math.round(255 * part)) + ")").join() + ")";
  stale = true;
  queue();
};

// --- the camera by hand ----------------------------------------------------------------------------------------

function setMode(to) { mode = to; easing = to === "swarm"; if (to === "whole") camera = aimed(true); stale = true; queue(); }
function free() { if (mode === "cell" && shown[0].camera) camera = { ...shown[0].camera, scale: camera.scale }; mode = "free"; easing = false; queue(); }
function zoom(factor, at) {
  if (mode !== "cell") free();
  view.zoomed(at && paneAt(...at), clamp(camera.scale * factor, 0.5, 2000), at);
  clearTimeout(settling); // what is stretched now is drawn anew when the hand rests
  settling = setTimeout(() => { stale = true; queue(); }, 150);
  queue();
}
let settling;
function pan(dx, dy) { free(); view.pan(dx, dy); queue(); }
function drag(dx, dy, aside) { if (aside || !view.turns) free(); (aside ? view.pan : view.drag)(dx, dy); queue(); }
function rest() { turning = false; $("turn").setAttribute("aria-pressed", "false"); }
function follow(cell) { chosen = cell; if (cell === null) { if (mode === "cell") setMode("swarm"); } else { mode = "cell"; view.zoomed(null, Math.max(camera.scale, 48)); easing = false; } stale = true; queue(); }
const paneAt = (x, y) => shown.find(p => x >= p.x && x < p.x + p.width && y >= p.y && y < p.y + p.height) || shown[0];
function nearest(x, y) {
  const pane = paneAt(x, y);
  let best = null, close = 18;
  for (let cell = 0; cell < pane.lives.n; cell++) {
    const [px, py] = onScreen(pane, cell), distance = Math.hypot(px - x, py - y);
    if (distance < close) { close = distance; best = cell; }
  }
  return [pane, best];
}
const box = $("stage"), touches = new Map();
let dragged = 0, spread = 0;
const spot = event => { const at = box.getBoundingClientRect(); return [event.clientX - at.left, event.clientY - at.top]; };
box.onpointerdown = event => {
  if (event.target.closest("button")) return;
  rest();
  box.setPointerCapture(event.pointerId);
  if (!touches.size) dragged = 0;
  touches.set(event.pointerId, spot(event));
  spread = 0;
};
box.onpointermove = event => {
  const at = spot(event), was = touches.get(event.pointerId);
  if (!was) { if (shown[0].camera) hover(...at); return; }
  touches.set(event.pointerId, at);
  if (touches.size === 1) {
    dragged += Math.abs(at[0] - was[0]) + Math.abs(at[1] - was[1]);
    if (dragged > 4) drag(at[0] - was[0], at[1] - was[1], event.shiftKey || event.buttons > 1);
  } else {
    const [a, b] = [...touches.values()], now = Math.hypot(a[0] - b[0], a[1] - b[1]);
    if (view.turns) drag((at[0] - was[0]) / 2, (at[1] - was[1]) / 2, true);
    dragged = 99;
    if (spread) zoom(now / spread, [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]);
    spread = now;
  }
};
box.onpointerup = box.onpointercancel = event => {
  if (!touches.delete(event.pointerId)) return;
  if (event.type === "pointerup" && dragged <= 4) { const [, cell] = nearest(...spot(event)); follow(cell); }
  stale = true;
  queue();
};
function hover(x, y) {
  const [pane, cell] = nearest(x, y), tip = $("tip");
  hovered = cell;
  tip.style.display = cell === null ? "none" : "block";
  if (cell !== null) {
    const facts = factsOf(pane.lives, cell);
    tip.textContent = "cell " + cell + (teams ? ", " + teams.names[teams.cells[cell]] : "") + Object.entries(facts).map(([key, value]) => "\n" + key + " " + value).join("");
    tip.style.left = clamp(x + 14, 4, box.clientWidth - 160) + "px"; tip.style.top = clamp(y + 14, 4, box.clientHeight - 140) + "px";
  }
  if (!playing) queue();
}
box.onpointerleave = () => { hovered = null; $("tip").style.display = "none"; if (!playing) queue(); };
box.addEventListener("wheel", event => { // within another page, only who has clicked here first zooms
  if (window.top !== window && !event.ctrlKey && document.activeElement !== box) return;
  event.preventDefault();
  zoom(Math.exp(-0.0015 * event.deltaY), spot(event));
}, { passive: false });
$("in").onclick = () => zoom(1.4); $("out").onclick = () => zoom(1 / 1.4); $("swarm").onclick = () => { chosen = null; setMode("swarm"); }; $("whole").onclick = () => { chosen = null; setMode("whole"); };
$("turn").hidden = !view.turns;
$("turn").setAttribute("aria-pressed", turning);
$("turn").onclick = () => { turning = !turning; $("turn").setAttribute("aria-pressed", turning); before = null; queue(); };
if (view.turns) $("keys").textContent = view.keys;
box.oncontextmenu = event => { if (view.turns) event.preventDefault(); };
$("release").onclick = () => follow(null);
const KEYS = {
  ArrowLeft: aside => drag(60, 0, aside), ArrowRight: aside => drag(-60, 0, aside), ArrowUp: aside => drag(0, 60, aside), ArrowDown: aside => drag(0, -60, aside), "+": () => zoom(1.25), "=": () => zoom(1.25), "-": () => zoom(0.8),
  0: $("swarm").onclick, 9: $("whole").onclick, n: () => follow(((chosen ?? -1) + 1) % some), p: () => follow(((chosen ?? 0) + some - 1) % some), Escape: () => follow(null),
};
document.onkeydown = event => {
  if (event.ctrlKey || event.metaKey || event.altKey || ["SELECT", "BUTTON", "INPUT"].includes(event.target.tagName) && event.key !== "Escape") return;
  const act = event.key === " " ? $("play").onclick : event.key === "," ? () => seek(now - 0.2) : event.key === "." ? () => seek(now + 0.2)
    : document.activeElement === box || event.key === "Escape" ? KEYS[event.key] : null;
  if (act) { event.preventDefault(); if (event.key.startsWith("Arrow")) rest(); act(event.shiftKey); }
};
let ready = false; // what has another size is drawn before it is shown
new ResizeObserver(() => { if (ready) { arrange(); draw(0); } }).observe(box);

try {
  for (const each of layers) each.films = each.films.map(film => new Film(film, each.least, each.most));
  stage = view.stage($("water"));
} catch (error) {
  $("failed").hidden = false;
  $("failed").textContent = "The picture needs WebGL 2, which this browser does not offer here; the numbers work.";
}
arrange();
$("layer").onchange();
if (asked.has("t")) now = clamp(Number(asked.get("t")) || 0, 0, end);
if (asked.has("turn") && view.turns) camera.azimuth = Number(asked.get("turn")) * Math.PI / 180 || 0;
if (asked.has("cell")) follow(clamp(Math.round(Number(asked.get("cell")) || 0), 0, some - 1));
arrange();
draw(0);
ready = true;
play(asked.has("play") ? asked.get("play") !== "0" : !asked.has("t") && !calm);

// Shaders: everything is placed by `view`, the centre of the picture and half its width and height [length].

const WHOLE = `
in vec2 corner;
out vec2 uv;
void main() { uv = 0.5 + 0.5 * corner; gl_Position = vec4(corner, 0.0, 1.0); }`;

// What is left of the trails: multiplied into them.
const FADING = `
precision mediump float;
uniform float left;
out vec4 colour;
void main() { colour = vec4(left); }`;

// The trails as they were, moved and magnified.
const MOVING = `
precision highp float;
uniform sampler2D old;
uniform vec3 move; // zoom, shift
in vec2 uv;
out vec4 colour;
void main() {
  vec2 from = 0.5 + (uv - 0.5) * move.x + move.yz, inside = step(vec2(0.0), from) * step(from, vec2(1.0));
  colour = texture(old, from) * inside.x * inside.y;
}`;

// The colour of water: its value and how much of that is known, with lines of equal value.
const TINTED = `
precision highp float;
precision highp sampler2DArray;
uniform sampler2DArray film;
uniform vec3 frame; // two frames and the part of the second
uniform vec2 levels; // value / step = v · levels.x + levels.y
uniform vec3 ramp[5], paper, line;
uniform float contrast; // of lines
vec3 tinted(vec2 found, float seen) {
  float v = clamp(found.r / max(found.g, 1e-3), 0.0, 1.0), f = 4.0 * v;
  vec3 c = mix(ramp[0], ramp[1], min(f, 1.0));
  for (int i = 1; i < 4; i++) c = mix(c, ramp[i + 1], clamp(f - float(i), 0.0, 1.0));
  float level = v * levels.x + levels.y, wide = max(fwidth(level), 1e-5);
  float close = 1.0 - smoothstep(0.0, 1.1, abs(fract(level + 0.5) - 0.5) / wide);
  float strong = mod(floor(level + 0.5), 5.0) < 0.5 ? 1.0 : 0.45;
  c = mix(c, line, contrast * close * strong * smoothstep(0.5, 0.1, wide) * step(1e-4, wide));
  float edge = 1.0 - smoothstep(0.6, 1.4, abs(found.g - 0.5) / max(fwidth(found.g), 1e-5)); // of what is known
  c = mix(mix(paper, line, 0.12), c, smoothstep(0.4, 0.6, found.g));
  return mix(paper, mix(c, line, 0.5 * edge), seen);
}`;

// Water in the plane, and the egg.
const WATER = `${TINTED}
uniform vec4 view, box, egg; // box: low, high; egg: x, y, radius, 0 none, 1 open, 2 closed
uniform vec2 size;
uniform vec3 shell;
uniform float pixel; // [length]
in vec2 uv;
out vec4 colour;
void main() {
  vec2 place = view.xy + (2.0 * uv - 1.0) * view.zw, q = (place - box.xy) / (box.zw - box.xy);
  vec2 at = (clamp(q, 0.0, 1.0) * (size - 1.0) + 0.5) / size;
  vec2 found = texture(film, vec3(at, frame.x)).rg;
  if (frame.z > 0.0) found = mix(found, texture(film, vec3(at, frame.y)).rg, frame.z);
  vec2 inside = min(q, 1.0 - q) * (box.zw - box.xy); // water fades before its grid ends: beyond, nobody knows it
  vec3 c = tinted(found, smoothstep(0.0, 0.6, min(inside.x, inside.y)));
  if (egg.w > 0.0) {
    float d = distance(place, egg.xy), r = max(egg.z, 5.0 * pixel);
    c = mix(c, shell, 0.45 * exp(-2.5 * max(d - r, 0.0) / r));
    c = mix(c, mix(shell * vec3(0.86, 0.62, 0.5), shell, smoothstep(0.1, 0.8, d / r)), 1.0 - smoothstep(r - pixel, r + pixel, d));
    if (egg.w > 1.5) c = mix(c, vec3(1.0), 1.0 - smoothstep(pixel, 2.0 * pixel, abs(d - 1.25 * r - 3.0 * pixel)));
  }
  colour = vec4(c, 1.0);
}`;

// Trails over water, each from a framebuffer that reaches further than the picture: pixel by pixel.
const OVER = `
precision mediump float;
uniform sampler2D water, trails;
uniform vec4 shift; // of both [pixels]
uniform vec2 cover; // of the water by trails; the light that 8 bits do not let fade, which is taken off
out vec4 colour;
void main() {
  vec4 trail = max(texelFetch(trails, ivec2(gl_FragCoord.xy + shift.zw), 0) - cover.y, 0.0) / (1.0 - cover.y);
  colour = vec4(texelFetch(water, ivec2(gl_FragCoord.xy + shift.xy), 0).rgb * (1.0 - cover.x * trail.a) + trail.rgb, 1.0);
}`;

// Lines as wide as is asked for, with a glow around them: four corners for each.
const LINES = `
uniform vec4 view;
uniform vec2 half_size; // [pixels]
uniform float reach; // [pixels]
in vec4 ends;
in vec4 tint;
out vec4 shade;
out vec3 away; // along and across [pixels], length
void main() {
  vec2 a = (ends.xy - view.xy) / view.zw * half_size, b = (ends.zw - view.xy) / view.zw * half_size;
  float span = length(b - a);
  vec2 along = span > 1e-6 ? (b - a) / span : vec2(1.0, 0.0), across = vec2(-along.y, along.x);
  float u = (gl_VertexID & 1) == 0 ? -reach : span + reach, v = (gl_VertexID & 2) == 0 ? -reach : reach;
  shade = tint;
  away = vec3(u, v, span);
  gl_Position = vec4((a + along * u + across * v) / half_size, 0.0, 1.0);
}`;
const GLOW = `
precision highp float;
uniform vec2 width; // of the core [pixels], strength of the glow
uniform float reach;
in vec4 shade;
in vec3 away;
out vec4 colour;
void main() {
  float d = length(vec2(away.x - clamp(away.x, 0.0, away.z), away.y));
  float core = 1.0 - smoothstep(width.x - 0.5, width.x + 0.6, d), g = max(0.0, 1.0 - d / reach);
  float a = shade.a * max(core, width.y * g * g);
  colour = vec4(shade.rgb * a, a);
}`;

// Heads: ellipses that point where their cells swim.
const HEADS = `
uniform vec4 view;
uniform float across; // [pixels of the screen]
in vec2 place;
in vec2 heading;
in vec4 tint;
out vec4 shade;
out vec2 ahead;
void main() {
  gl_Position = vec4((place - view.xy) / view.zw, 0.0, 1.0);
  gl_PointSize = across + 2.0;
  shade = tint;
  ahead = heading;
}`;
const HEAD = `
precision highp float;
uniform float across;
uniform vec3 rim;
in vec4 shade;
in vec2 ahead;
out vec4 colour;
void main() {
  vec2 p = (gl_PointCoord - 0.5) * vec2(1.0, -1.0) * (across + 2.0), q = vec2(dot(p, ahead), dot(p, vec2(-ahead.y, ahead.x)) / 0.62);
  float d = length(q) - 0.5 * across, a = 1.0 - smoothstep(-0.4, 1.0, d);
  colour = vec4(mix(shade.rgb, rim, smoothstep(-1.9, -0.9, d)), 1.0) * a * shade.a;
}`;

// Heads of many: ellipses alone.
const SPECK = `
precision mediump float;
in vec4 shade;
in vec2 ahead;
out vec4 colour;
void main() {
  vec2 p = 2.0 * gl_PointCoord - 1.0, q = vec2(p.x * ahead.x - p.y * ahead.y, p.x * ahead.y + p.y * ahead.x);
  float a = clamp(2.2 - 2.4 * dot(q, q * vec2(1.0, 2.2)), 0.0, 1.0) * shade.a;
  colour = vec4(shade.rgb * a, a);
}`;

// The ways of the circles' centres.
const WAYS = `
uniform vec4 view;
in vec2 place;
void main() { gl_Position = vec4((place - view.xy) / view.zw, 0.0, 1.0); }`;
const WAY = `
precision mediump float;
uniform vec4 tint;
out vec4 colour;
void main() { colour = vec4(tint.rgb * tint.a, tint.a); }`;

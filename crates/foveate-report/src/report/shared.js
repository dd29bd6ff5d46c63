'use strict';
// What every page shares: the replays of a run, and the page of `foveate serve`.
const byId = id => document.getElementById(id);
function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}
// SVG from text of our own making; never from data.
function drawing(markup) {
  const holder = document.createElement('template');
  holder.innerHTML = markup;
  return holder.content.firstElementChild;
}
// A count and its noun, given in the singular; regular plurals alone.
const counted = (n, noun) => `${n} ${noun}${n === 1 ? '' : /(s|x|ch|sh)$/.test(noun) ? 'es' : 's'}`;
const colour = name => getComputedStyle(document.documentElement).getPropertyValue('--' + name).trim();
const bytes = text => Uint8Array.from(atob(text || ''), c => c.charCodeAt(0));
const words = text => { const b = bytes(text); return Array.from({ length: b.length >> 1 }, (_, i) => b[2 * i] | b[2 * i + 1] << 8); };
// A canvas that is as sharp as the screen; returns its context, drawn in CSS pixels.
function sharp(canvas, width, height) {
  const ratio = window.devicePixelRatio || 1;
  const [w, h] = [Math.max(1, Math.round(width * ratio)), Math.max(1, Math.round(height * ratio))];
  if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
  const context = canvas.getContext('2d');
  context.setTransform(w / width, 0, 0, h / height, 0, 0);
  return context;
}
// Weight relative to the heaviest, to a colour: violet over rose to pale yellow (dark to bright for any eye).
const ramp = [[111, 71, 230], [224, 82, 143], [255, 236, 130]];
const tint = t => {
  const [a, b, f] = t < .5 ? [ramp[0], ramp[1], 2 * t] : [ramp[1], ramp[2], 2 * t - 1];
  return a.map((c, i) => Math.round(c + f * (b[i] - c)));
};
// Particles of `key` on a picture of `width` by `height`, drawn `k` times as large; `at` returns where a place is drawn.
function drawCloud(c, key, [width, height], at, k) {
  key.cloud ||= (place => Array.from(bytes(key.weights), (w, i) => [
    (place[2 * i] / 65535 * 3 - 1) * width, (place[2 * i + 1] / 65535 * 3 - 1) * height, w / 255,
  ]).sort((a, b) => a[2] - b[2]))(words(key.particles));
  const radius = Math.min(3.4, Math.max(1.4, .5 * k));
  for (const [x, y, weight] of key.cloud) {
    const t = Math.sqrt(weight);
    c.beginPath(); c.arc(...at(x, y), radius * (.75 + .5 * t), 0, 7);
    c.fillStyle = `rgb(${tint(t).join(' ')} / ${.45 + .5 * t})`; c.fill();
    c.strokeStyle = `rgb(0 0 0 / ${.15 + .35 * t})`; c.lineWidth = .7; c.stroke();
  }
}
// Lines that are seen on any picture: `cased` strokes a path in ink over a dark line, `outline` is the path of a polygon, and `cross`
// draws one.
function penOf(c, shade = .6) {
  const cased = (path, ink, thick, dash = []) => {
    c.setLineDash(dash);
    c.beginPath(); path();
    c.strokeStyle = `rgb(0 0 0 / ${shade})`; c.lineWidth = thick + 2; c.stroke();
    c.strokeStyle = ink; c.lineWidth = thick; c.stroke();
    c.setLineDash([]);
  };
  const outline = corners => () => { c.moveTo(...corners[corners.length - 1]); corners.forEach(p => c.lineTo(...p)); };
  const cross = (x, y, arm, ink, thick = 1.8) => cased(() => { c.moveTo(x - arm, y); c.lineTo(x + arm, y); c.moveTo(x, y - arm); c.lineTo(x, y + arm); }, ink, thick);
  return { cased, outline, cross };
}
// A retina's windows from its cells (u, v, half a side, channel of each): half their sides in template units, the innermost first, of its
// grey cells by their size.
function windowsOf(cells) {
  const found = new Map();
  for (let i = 0; i < cells.length; i += 4) {
    if (cells[i + 3] !== 0) continue;
    const reach = Math.max(Math.abs(cells[i]), Math.abs(cells[i + 1])) + cells[i + 2];
    found.set(cells[i + 2], Math.max(reach, found.get(cells[i + 2]) || 0));
  }
  return [...found.values()].sort((a, b) => a - b);
}
// Which cell of a retina is seen where, channel by channel, on a raster of its smallest cells; null without cells.
function eyeOf(flat) {
  const cells = Array.from({ length: flat.length / 4 }, (_, i) => flat.slice(4 * i, 4 * i + 4));
  if (!cells.length) return null;
  const reach = Math.max(...cells.map(([u, v, half]) => Math.max(Math.abs(u), Math.abs(v)) + half));
  const within = (x, low, high) => Math.min(high, Math.max(low, Math.round(x)));
  const side = within(reach / Math.min(...cells.map(cell => cell[2])), 1, 192);
  const maps = [0, 1, 2].map(() => new Int32Array(side * side).fill(-1));
  cells.forEach(([u, v, half, channel], i) => {
    const pixel = x => within((x + reach) / (2 * reach) * side, 0, side);
    for (let y = pixel(v - half); y < pixel(v + half); y++) for (let x = pixel(u - half); x < pixel(u + half); x++) maps[channel][y * side + x] = i;
  });
  return { side, maps };
}
// What its channels say of a colour: grey is BT.601 luma, then (red − green) / 2, (2 blue − red − green) / 4.
function colourOf(eye, values, pixel) {
  const [grey, rg, by] = eye.maps.map(map => map[pixel]);
  if (grey < 0 || !values.length) return null;
  const a = rg < 0 ? 0 : 2 * (values[rg] - 128), b = by < 0 ? 0 : 4 * (values[by] - 128), green = values[grey] - .356 * a - .057 * b;
  return [green + a, green, (b + 2 * green + a) / 2];
}
// A glimpse cell by cell: `rgbOf` returns the colour of a pixel of the raster, if it has one.
function paintGlimpse(canvas, eye, rgbOf) {
  const side = eye ? eye.side : 1;
  canvas.width = canvas.height = side;
  const context = canvas.getContext('2d'), out = context.createImageData(side, side);
  for (let i = 0; eye && i < side * side; i++) {
    const rgb = rgbOf(i);
    if (rgb) out.data.set([...rgb, 255], 4 * i);
  }
  context.putImageData(out, 0, 0);
}
const drawGlimpse = (canvas, eye, values) => paintGlimpse(canvas, eye, i => colourOf(eye, values, i));

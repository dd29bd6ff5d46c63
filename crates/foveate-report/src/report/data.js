// The run: one value a row (frame) in `series`, pictures, targets and particles in `keys` (some of the rows). Only one target has columns
// besides frame and time, and only a tracker of one target has particles and glimpses.
const { info, series, keys, arms } = data;
const rows = series.frame.length;
const [frameWidth, frameHeight] = data.size, viewed = data.particles > 0;

// A number as people read it: three figures (two below 1), a real minus, a dash for "none".
function say(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return '–';
  const size = Math.abs(value);
  if (size < 5e-4) return size === 0 ? '0' : '0.000';
  const power = Math.floor(Math.log10(size)), places = power < 0 ? digits - 2 - power : digits - 1 - power;
  const text = size >= 1e6 ? value.toExponential(1) : value.toFixed(Math.max(0, places));
  return text.replace('-', '−');
}

// Runs of rows in which the box is not usable, the status being occluded or lost: [first, last]. A given box has no status.
const lostRuns = [];
const isGuess = row => series.usable[row] === 0;
series.usable.forEach((_, row) => {
  if (!isGuess(row)) return;
  const last = lostRuns[lostRuns.length - 1];
  if (last && last[1] === row - 1) last[1] = row; else lostRuns.push([row, row]);
});
// A policy with one gaze has nothing to show.
const gazes = series.u.map((u, row) => [u, series.v[row]]).filter(([u]) => u !== null);
const fixed = !data.surface && arms.length < 2 && gazes.every(([u, v]) => u === gazes[0][0] && v === gazes[0][1]);

const median = list => { const s = list.filter(v => v !== null).sort((a, b) => a - b); return s.length ? s[s.length >> 1] : null; };

// Half the width and height of the box, as State::half has it.
function half(row) {
  const s = Math.exp(series.log_scale[row]), wider = Math.exp(series.log_aspect[row] / 2);
  return [s * wider * series.half_w[row], s * series.half_h[row] / wider];
}

// Where a gaze falls on the image, as State::fixate has it: centre, and one template unit along u and v.
function fixate(row, u, v) {
  const [w, h] = half(row), sin = Math.sin(series.angle[row]), cos = Math.cos(series.angle[row]);
  return { x: series.x[row] + cos * w * u - sin * h * v, y: series.y[row] + sin * w * u + cos * h * v, ux: cos * w, uy: sin * w, vx: -sin * h, vy: cos * h };
}

const windows = windowsOf(data.cells);

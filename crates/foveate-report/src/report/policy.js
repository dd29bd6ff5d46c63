// The gaze policy: on the template, as bars, and over time.
const templatePicture = data.template && picture(data.template.jpeg);
if (templatePicture) templatePicture.onload = () => drawPolicy();
const probabilities = keys.map(() => null);
// Probabilities at a key, or for policies that state none, how often each arm was chosen in the last frames.
const RECENT = 30;
function policyAt(k) {
  if (probabilities[k]) return probabilities[k];
  if (data.learned) return probabilities[k] = words(keys[k].policy).map(p => p / 65535);
  const counts = arms.map(() => 0), row = keys[k].row;
  let all = 0;
  for (let r = Math.max(0, row - RECENT + 1); r <= row; r++) if (series.arm[r] !== null) { counts[series.arm[r]]++; all++; }
  return probabilities[k] = counts.map(n => all ? n / all : 0);
}
// A small square with a point at a gaze.
const widest = Math.max(1, ...arms.flat().map(Math.abs));
const padMarkup = ([u, v]) => `<svg viewBox="-10 -10 20 20" aria-hidden="true"><rect x="-9" y="-9" width="18" height="18" rx="3" fill="none" stroke="currentColor" stroke-opacity=".45"/><circle cx="${6 * u / widest}" cy="${6 * v / widest}" r="2.6" fill="currentColor"/></svg>`;
const listed = arms.length > 1 && arms.length <= 12;
const armRows = listed ? arms.map(at => {
  const bar = element('i'), p = element('span', { class: 'p' });
  const line = element('div', { class: 'arm', title: `gaze (${say(at[0], 2)}, ${say(at[1], 2)}) in half-boxes` }, drawing(padMarkup(at)), element('span', { class: 'bar' }, bar), p);
  byId('arms').append(line);
  return { line, bar, p };
}) : [];
if (!listed) document.querySelector('.policy').classList.add('wide');

function drawPolicy() {
  if (fixed) return;
  const key = keys[now], row = key.row, p = policyAt(now), chosen = series.arm[row];
  if (series.u[row] === null) byId('gaze').textContent = 'no gaze in this frame';
  else byId('gaze').replaceChildren('gaze ', element('b', {}, `(${say(series.u[row], 2)}, ${say(series.v[row], 2)})`), ' half-boxes');
  if (!land) byId('template-caption').textContent = data.learned ? 'area of a disc: probability of the gaze, or its mixing weight' : `area of a disc: share of the last ${RECENT} gazes`;
  armRows.forEach(({ line, bar, p: text }, i) => {
    line.classList.toggle('now', i === chosen);
    bar.style.width = `${100 * (p[i] || 0)}%`;
    text.textContent = p.length ? `${(100 * p[i]).toFixed(p[i] < .0995 ? 1 : 0)} %` : '–';
  });
  const canvas = byId('template'), size = canvas.clientWidth || 220, c = sharp(canvas, size, size);
  c.clearRect(0, 0, size, size);
  // The template's box in the target's proportions, within reason.
  const [u0, v0, u1, v1] = data.template ? data.template.box : [-1.4, -1.4, 1.4, 1.4];
  const slim = Math.min(2.2, Math.max(.45, series.half_w[row] / series.half_h[row]));
  const unit = size / Math.max((u1 - u0) * slim, v1 - v0), unitU = unit * slim;
  const at = (u, v) => [size / 2 + (u - (u0 + u1) / 2) * unitU, size / 2 + (v - (v0 + v1) / 2) * unit];
  const ground = c => {
    if (!templatePicture || !templatePicture.complete) return;
    c.imageSmoothingEnabled = size / templatePicture.naturalWidth < 3;
    const [left, top] = at(u0, v0), [right, low] = at(u1, v1);
    c.drawImage(templatePicture, left, top, right - left, low - top);
    c.fillStyle = `rgb(8 10 14 / ${land ? .12 : .38})`;
    c.fillRect(left, top, right - left, low - top);
  };
  ground(c);
  if (land) {
    land.paint(c, at, 0);
    const gaze = (x, y) => [(x - size / 2) / unitU + (u0 + u1) / 2, (y - size / 2) / unit + (v0 + v1) / 2];
    land.beside(size, c => { ground(c); land.paint(c, at, 1); }, gaze);
  }
  const frame = (u, v, reach, ink, thick) => { c.strokeStyle = ink; c.lineWidth = thick; const [x, y] = at(u - reach, v - reach), [x2, y2] = at(u + reach, v + reach); c.strokeRect(x, y, x2 - x, y2 - y); };
  frame(0, 0, 1, '#39b6ff', 1.6);
  const gap = arms.length > 1 ? Math.min(...arms.slice(1).map((a, i) => Math.hypot(unitU * (a[0] - arms[i][0]), unit * (a[1] - arms[i][1])))) : size;
  arms.forEach(([u, v], i) => {
    const [x, y] = at(u, v), full = Math.max(12, Math.min(.12 * size, .95 * gap));
    c.beginPath(); c.arc(x, y, Math.max(2.2, full * Math.sqrt(p[i] || 0)), 0, 7);
    c.fillStyle = 'rgb(120 205 255 / .8)'; c.fill();
    c.strokeStyle = 'rgb(0 0 0 / .5)'; c.lineWidth = 1; c.stroke();
  });
  if (!arms.length && !land) trail(c, at, row);
  if (series.u[row] !== null) {
    const u = series.u[row], v = series.v[row], [x, y] = at(u, v);
    windows.slice(0, 1).forEach(reach => frame(u, v, reach, '#ffb627', 1.8));
    c.strokeStyle = '#fff'; c.lineWidth = 2;
    c.beginPath(); c.moveTo(x - 7, y); c.lineTo(x + 7, y); c.moveTo(x, y - 7); c.lineTo(x, y + 7); c.stroke();
  }
}

// Continuous gazes: those of the last frames.
function trail(c, at, row) {
  for (let r = Math.max(0, row - 40); r <= row; r++) {
    if (series.u[r] === null) continue;
    c.beginPath(); c.arc(...at(series.u[r], series.v[r]), 3.4, 0, 7);
    c.fillStyle = `rgb(120 205 255 / ${.9 - .8 * (row - r) / 41})`; c.fill();
  }
}

// One line an arm, one column a frame; the chosen gaze is marked.
const film = arms.length > 1 && {
  canvas: element('canvas', { role: 'img', 'aria-label': 'Probability of each gaze over time' }), left: 34, bottom: 18,
  high: Math.max(6, Math.min(17, 260 / arms.length)),
};
byId('film').closest('.card').hidden = !film;
document.querySelector('.where').hidden = fixed;
document.querySelector('main').classList.toggle('fixed', fixed && viewed);
document.querySelector('main').classList.toggle('wide', !viewed);
document.querySelector('.fovea').hidden = !viewed;
if (film) {
  const plot = element('div', { class: 'plot' }, film.canvas);
  byId('film').append(plot);
  byId('film-note').textContent = data.learned
    ? 'a row a gaze, a column a frame; blue: its probability; amber: chosen' : `a row a gaze: its share of the last ${RECENT} frames; amber: chosen`;
  scrubOver(plot, () => film.left, () => plot.clientWidth - film.left - 12);
}
function drawFilm() {
  if (!film) return;
  const width = byId('film').clientWidth, tall = film.high * arms.length, whole = tall + film.bottom, c = sharp(film.canvas, width, whole);
  film.canvas.style.height = whole + 'px';
  const room = width - film.left - 12, x = row => film.left + (row + .5) / rows * room, ratio = window.devicePixelRatio || 1;
  c.clearRect(0, 0, width, whole);
  c.drawImage(film.base, 0, 0, width, whole);
  c.fillStyle = colour('ink');
  c.globalAlpha = .65;
  c.fillRect(Math.round(x(keys[now].row) * ratio) / ratio, 0, 1, tall);
  c.globalAlpha = 1;
}
// All of it but the cursor, drawn when the page's layout changes.
function developFilm() {
  if (!film) return;
  film.base = document.createElement('canvas');
  const width = byId('film').clientWidth, tall = film.high * arms.length, c = sharp(film.base, width, tall + film.bottom);
  const ratio = window.devicePixelRatio || 1, room = width - film.left - 12, x = row => film.left + (row + .5) / rows * room, step = room / rows;
  c.fillStyle = colour('sunken');
  c.fillRect(film.left, 0, room, tall);
  const [target, soft, ink] = ['target', 'soft', 'ink'].map(colour);
  c.fillStyle = target;
  keys.forEach((key, k) => {
    const edge = row => Math.round((film.left + row * step) * ratio) / ratio;
    const from = edge(key.row), to = edge(k + 1 < keys.length ? keys[k + 1].row : rows);
    policyAt(k).forEach((p, i) => {
      c.globalAlpha = Math.pow(p, .6);
      c.fillRect(from, i * film.high, to - from, film.high - 1);
    });
  });
  c.globalAlpha = 1;
  c.strokeStyle = 'rgb(60 35 0 / .75)';
  series.arm.forEach((arm, row) => {
    if (arm === null) return;
    const y = (arm + .5) * film.high - .5, r = Math.min(2.7, film.high * .3);
    if (step >= 4.5) {
      c.fillStyle = '#ffb627';
      c.beginPath(); c.arc(x(row), y, r, 0, 7); c.fill(); c.stroke();
    } else {
      const w = Math.max(1, step * .7);
      c.fillStyle = '#f0a000';
      c.fillRect(x(row) - w / 2, y - r, w, 2 * r);
    }
  });
  // Small maps of where each row's gaze lies.
  arms.forEach(([u, v], i) => {
    const s = Math.min(film.high - 3, 13), px = 14, py = (i + .5) * film.high - .5;
    c.strokeStyle = soft; c.globalAlpha = .5; c.lineWidth = 1; c.strokeRect(px - s / 2, py - s / 2, s, s); c.globalAlpha = 1;
    c.fillStyle = ink; c.beginPath(); c.arc(px + u / widest * s * .32, py + v / widest * s * .32, 1.9, 0, 7); c.fill();
  });
  frameTicks(room).forEach(({ at, text, anchor }) => {
    c.fillStyle = soft; c.font = LABEL; c.textAlign = anchor === 'end' ? 'right' : 'center';
    c.fillText(text, film.left + at * room, tall + 13);
  });
}

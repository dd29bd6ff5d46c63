// The frame with the belief drawn on it.
const BASELINES = ['#b18cff', '#dd8fb8'];
const layers = [
  { key: 'b', name: 'box', label: 'box', dot: '#39b6ff' },
  ...(series.true_x.some(x => x !== null) ? [{ key: 't', name: 'truth', label: 'truth', dot: '#3fd19b' }] : []),
  ...data.baselines.map(({ name }, i) => ({ key: 'fr'[i], name: `baseline${i}`, label: name, dot: BASELINES[i] })),
  { key: 'h', name: 'path', label: 'path', dot: '#39b6ff' },
  ...(viewed ? [{ key: 'p', name: 'particles', label: 'particles', dot: '#e0528f' }, { key: 'u', name: 'ellipse', label: 'uncertainty', dot: '#9aa4ad' }] : []),
  { key: 'g', name: 'fixation', label: 'gaze', dot: '#ffb627' },
  ...(viewed ? [{ key: 'z', name: 'zoom', label: 'close up' }] : []),
];
const shown = {};
for (const layer of layers) {
  const box = element('input', { type: 'checkbox' });
  box.checked = shown[layer.name] = true;
  layer.box = box;
  if (layer.dot) box.style.setProperty('--dot', layer.dot);
  box.addEventListener('change', () => { shown[layer.name] = box.checked; drawStage(); });
  byId('toggles').append(element('label', { title: `Key ${layer.key}` }, box, layer.label));
}

const stills = keys.map(() => null);
const still = k => stills[k] ||= (image => { image.onload = () => { if (k === now) drawStage(); }; return image; })(picture(keys[k].jpeg));

// The close-up stands in the corner that is farthest from the target, and moves only when the target comes near.
const aspect = frameWidth / frameHeight, INSET = .31;
const share = row => Math.max(half(row)[0] / frameWidth, half(row)[1] / frameHeight);
const small = keys.some(key => 2 * share(key.row) < .3);
if (viewed && !small) { shown.zoom = false; layers.find(l => l.name === 'zoom').box.checked = false; }
const corners = [];
keys.reduce((corner, { row }) => {
  const [x, y] = [(series.x[row] + .5) / frameWidth, (series.y[row] + .5) / frameHeight];
  const apart = ([right, low]) => Math.max(right ? 1 - x : x, low ? 1 - y : y);
  const size = share(row);
  const best = [[1, 0], [0, 0], [1, 1], [0, 1]].reduce((a, b) => apart(b) > apart(a) + 1e-9 ? b : a);
  corners.push(corner && apart(corner) > INSET + .06 + size ? corner : best);
  return corners[corners.length - 1];
}, null);

function drawStage() {
  const key = keys[now], row = key.row, canvas = byId('screen'), screen = canvas.parentElement;
  const room = Math.max(260, window.innerHeight * .74);
  const fit = Math.min(screen.clientWidth / frameWidth, room / frameHeight);
  const width = Math.floor(frameWidth * fit), height = Math.floor(frameHeight * fit);
  canvas.style.width = width + 'px';
  canvas.style.height = height + 'px';
  const c = sharp(canvas, width, height);
  for (let ahead = 1; ahead < 10 && now + ahead < keys.length; ahead++) still(now + ahead);
  drawView(c, key, { x: 0, y: 0, w: frameWidth }, { x: 0, y: 0, w: width, h: height });
  if (shown.zoom) {
    const h = INSET * Math.min(width, height), [right, low] = corners[now], inset = { x: right ? width - h - 10 : 10, y: low ? height - h - 10 : 10, w: h, h };
    c.save();
    c.shadowColor = 'rgb(0 0 0 / .7)'; c.shadowBlur = 14; c.fillStyle = '#08090b';
    c.beginPath(); c.roundRect(inset.x, inset.y, h, h, 6); c.fill();
    c.shadowBlur = 0; c.clip();
    drawView(c, key, closeUp(row), inset);
    c.restore();
    c.beginPath(); c.roundRect(inset.x, inset.y, h, h, 6);
    c.strokeStyle = 'rgb(255 255 255 / .8)'; c.lineWidth = 1.4; c.stroke();
  }
  if (series.status[row]) banner(c, data.statuses[series.status[row]], width, isGuess(row) ? undefined : 'rgb(0 110 75 / .92)');
  else if (viewed && series.ess[row] === null) banner(c, 'box given', width, 'rgb(0 95 155 / .92)');
  canvas.setAttribute('aria-label', describe(row));
}

// What the close-up shows: a square of the frame around the target.
function closeUp(row) {
  const w = 3.3 * Math.max(...half(row));
  return { x: series.x[row] + .5 - w / 2, y: series.y[row] + .5 - w / 2, w };
}

// One part of the frame, `view` in image pixels, drawn into `box` of the canvas.
function drawView(c, key, view, box) {
  const row = key.row, k = box.w / view.w, image = still(keys.indexOf(key));
  // Pixel centres lie at whole coordinates: the picture starts half a pixel earlier.
  const at = (x, y) => [box.x + k * (x + .5 - view.x), box.y + k * (y + .5 - view.y)];
  c.fillStyle = '#08090b';
  c.fillRect(box.x, box.y, box.w, box.h);
  if (image.complete && image.naturalWidth) {
    const magnified = k * frameWidth / image.naturalWidth * (window.devicePixelRatio || 1);
    c.imageSmoothingEnabled = magnified < 3;
    c.imageSmoothingQuality = 'high';
    c.drawImage(image, box.x - k * view.x, box.y - k * view.y, k * frameWidth, k * frameHeight);
  }
  c.lineJoin = c.lineCap = 'round';
  const drawn = penOf(c, .55), { cased, outline } = drawn;
  if (shown.particles && key.particles) drawCloud(c, key, [frameWidth, frameHeight], at, k);
  if (shown.path) {
    for (let i = now; i > 0 && row - keys[i].row < 60; i--) for (const { id, colour, at: end } of keys[i].targets) {
      const start = keys[i - 1].targets.find(before => before.id === id)?.at;
      if (!start) continue;
      c.beginPath();
      for (const p of [start, end]) c.lineTo(...at((p[0] + p[4]) / 2, (p[1] + p[5]) / 2));
      c.globalAlpha = .85 * (1 - (row - keys[i].row) / 60);
      c.strokeStyle = colour; c.lineWidth = 1.8; c.stroke();
    }
    c.globalAlpha = 1;
  }
  if (shown.truth && series.true_x[row] !== null) {
    const [x, y] = at(series.true_x[row] - series.true_w[row] / 2, series.true_y[row] - series.true_h[row] / 2);
    cased(() => c.rect(x, y, k * series.true_w[row], k * series.true_h[row]), '#3fd19b', 2, [2, 4]);
  }
  data.baselines.forEach(({ x, y, w, h }, i) => {
    if (!shown[`baseline${i}`] || x[row] === null) return;
    const [left, top] = at(x[row] - w[row] / 2, y[row] - h[row] / 2);
    cased(() => c.rect(left, top, k * w[row], k * h[row]), BASELINES[i], 2);
  });
  if (shown.box) for (const target of key.targets) drawTarget(c, target, at, drawn);
  if (shown.ellipse && series.cov_xx[row] !== null) {
    const [a, b, d] = [series.cov_xx[row], series.cov_xy[row], series.cov_yy[row]];
    const middle = (a + d) / 2, apart = Math.hypot((a - d) / 2, b), turn = .5 * Math.atan2(2 * b, a - d);
    const [r1, r2] = [middle + apart, middle - apart].map(v => k * Math.sqrt(data.credible * Math.max(v, 0)));
    cased(() => c.ellipse(...at(series.x[row], series.y[row]), r1, r2, turn, 0, 7), '#ffffff', 1.2, [3, 4]);
  }
  if (shown.fixation && !viewed) for (const target of key.targets) drawn.cross(...at(target.at[8], target.at[9]), 5, target.colour);
  if (shown.fixation && viewed && series.u[row] !== null) {
    for (const [u, v] of key.also || []) drawFixation(c, row, u, v, at, drawn, false);
    drawFixation(c, row, series.u[row], series.v[row], at, drawn, true);
  }
}

// The box of a target, its corners alone if it is occluded or lost; its name, if there may be others.
function drawTarget(c, target, at, { cased, outline }) {
  const corners = [0, 2, 4, 6].map(i => at(target.at[i], target.at[i + 1]));
  cased(target.corners ? () => corners.forEach(([x, y], i) => {
    const [[ax, ay], [bx, by]] = [corners[(i + 3) % 4], corners[(i + 1) % 4]];
    c.moveTo(x + .2 * (ax - x), y + .2 * (ay - y)); c.lineTo(x, y); c.lineTo(x + .2 * (bx - x), y + .2 * (by - y));
  }) : outline(corners), target.colour, 2);
  if (viewed) return;
  c.font = '600 13px system-ui, "DejaVu Sans", sans-serif'; c.textBaseline = 'alphabetic'; c.textAlign = 'left';
  const [left, top] = [0, 1].map(axis => Math.min(...corners.map(corner => corner[axis]))), wide = c.measureText(target.name).width + 8;
  const [x, y] = [Math.max(0, Math.min(left, c.canvas.clientWidth - wide)), top > 22 ? top - 20 : top + 4];
  c.fillStyle = 'rgb(0 0 0 / .6)'; c.fillRect(x, y, wide, 17);
  c.fillStyle = target.colour; c.fillText(target.name, x + 4, y + 13);
}

// A cross at the gaze; around the chosen one the windows of the retina.
function drawFixation(c, row, u, v, at, { cased, outline, cross }, chosen) {
  const f = fixate(row, u, v), [x, y] = at(f.x, f.y);
  if (chosen) windows.forEach((reach, i) => {
    const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([a, b]) => at(f.x + reach * (a * f.ux + b * f.vx), f.y + reach * (a * f.uy + b * f.vy)));
    if (i === 0) cased(outline(corners), '#ffb627', 1.8);
    else { c.beginPath(); outline(corners)(); c.strokeStyle = `rgb(255 182 39 / ${.75 / i})`; c.lineWidth = 1; c.stroke(); }
  });
  cross(x, y, chosen ? 8 : 5, chosen ? '#ffffff' : '#ffb627', chosen ? 2 : 1.5);
}

function banner(c, text, width, ground = 'rgb(194 74 0 / .94)') {
  c.font = '600 13px system-ui, "DejaVu Sans", sans-serif';
  const w = c.measureText(text).width + 22;
  c.fillStyle = ground;
  c.beginPath(); c.roundRect((width - w) / 2, 10, w, 25, 12.5); c.fill();
  c.fillStyle = '#fff'; c.textBaseline = 'middle'; c.textAlign = 'center';
  c.fillText(text, width / 2, 23);
}

const describe = row => !viewed ? `Frame ${series.frame[row]}: ${counted(keys[now].targets.length, 'target')}` : `Frame ${series.frame[row]}: target at ${say(series.x[row])}, ${say(series.y[row])} px` +
  (series.ess[row] === null ? ', box given' : `, gaze at ${say(series.u[row], 2)}, ${say(series.v[row], 2)}${series.status[row] ? `, ${data.statuses[series.status[row]]}` : ''}`);

// The frame with the belief drawn on it.
const layers = [
  { name: 'box', label: 'box', dot: '#39b6ff' }, { name: 'truth', label: 'truth', dot: '#3fd19b' },
  { name: 'path', label: 'path', dot: '#39b6ff' }, { name: 'particles', label: 'particles', dot: '#e0528f' },
  { name: 'region', label: 'uncertainty', dot: '#9aa4ad' }, { name: 'gaze', label: 'gaze', dot: '#ffb627' },
  { name: 'scale', label: 'scale and axes', dot: '#ff8fe0' },
];
for (const layer of layers) {
  const box = element('input', { type: 'checkbox', checked: '' });
  box.style.setProperty('--dot', layer.dot);
  box.addEventListener('change', () => drawStage());
  layer.box = box;
  layer.holder = element('label', {}, box, layer.label);
  byId('toggles').append(layer.holder);
}
const shows = name => layers.find(layer => layer.name === name).box.checked;
let shown = null;   // the picture on the stage, and its frame

function stageSize() {
  const { width, height } = page.video, room = Math.max(220, window.innerHeight * .68);
  const fit = Math.min(byId('holder').clientWidth / width, room / height, 6);
  return [Math.max(1, Math.floor(width * fit)), Math.max(1, Math.floor(height * fit))];
}

function drawStage() {
  if (!page.video) return;
  const canvas = byId('screen'), [width, height] = stageSize();
  canvas.style.width = width + 'px';
  canvas.style.height = height + 'px';
  const context = sharp(canvas, width, height), k = width / page.video.width;
  paint(context, width, height, true);
  if (page.tool?.held && shown) paintLoupe(context, width, height, (x, y) => [k * (x + .5), k * (y + .5)]);
}

// The frame shown, `width` by `height`; with the box in hand if `hand` is set.
function paint(c, width, height, hand) {
  const k = width / page.video.width, frame = shown ? shown.frame : page.frame, row = rowOf(frame), detail = page.details.get(frame);
  // Pixel centres lie at whole coordinates: the picture starts half a pixel earlier.
  const at = (x, y) => [k * (x + .5), k * (y + .5)], edge = (x, y) => [k * x, k * y];
  c.fillStyle = '#08090b';
  c.fillRect(0, 0, width, height);
  if (shown) {
    c.imageSmoothingEnabled = k < 3;
    c.imageSmoothingQuality = 'high';
    c.drawImage(shown.picture, 0, 0, width, height);
  }
  c.lineJoin = c.lineCap = 'round';
  const { cased, outline, cross } = penOf(c);
  if (detail && shows('particles')) drawCloud(c, detail, [page.video.width, page.video.height], at, k);
  if (shows('path')) for (let f = Math.max(page.first + 1, frame - 60); f <= frame; f++) {
    const [a, b] = [rowOf(f - 1), rowOf(f)];
    if (!a || !b) continue;
    const middle = r => at(r.box[0] + r.box[2] / 2 - .5, r.box[1] + r.box[3] / 2 - .5);
    c.beginPath(); c.moveTo(...middle(a)); c.lineTo(...middle(b));
    c.strokeStyle = `rgb(57 182 255 / ${.85 * (1 - (frame - f) / 60)})`; c.lineWidth = 1.8; c.stroke();
  }
  const truth = page.video.truth[frame - 1];
  if (truth && shows('truth')) cased(() => c.rect(...edge(truth[0], truth[1]), k * truth[2], k * truth[3]), '#3fd19b', 2, [2, 4]);
  if (shows('box')) page.targets.forEach((target, i) => {
    const other = rowOf(frame, target), ink = i === page.target ? '#39b6ff' : '#c9a6ff';
    if (!other || page.targets.length < 2) return;
    if (i !== page.target) cased(outline(other.corners.map(([x, y]) => at(x, y))), ink, 1.6, other.usable ? [] : [7, 6]);
    const [x, y] = edge(other.box[0], other.box[1]), size = Math.max(11, Math.min(16, width / 45));
    c.font = `700 ${size}px system-ui, sans-serif`;
    c.lineWidth = 3; c.strokeStyle = 'rgb(8 9 11 / .8)'; c.fillStyle = ink;
    c.strokeText(String(i + 1), x + 1, Math.max(size, y - 4));
    c.fillText(String(i + 1), x + 1, Math.max(size, y - 4));
  });
  if (row && shows('box')) cased(outline(row.corners.map(([x, y]) => at(x, y))), row.usable ? '#39b6ff' : '#ff8a4a', 2, row.usable ? [] : [7, 6]);
  if (row?.region && shows('region')) {
    const [x, y, a, b, turn] = row.region;
    if (a !== null) cased(() => c.ellipse(...at(x, y), k * a, k * b, turn, 0, 7), '#ffffff', 1.2, [3, 4]);
  }
  if (row?.fixation && shows('gaze')) {
    const [x, y, ux, uy, vx, vy] = row.fixation, corner = (reach, a, b) => at(x + reach * (a * ux + b * vx), y + reach * (a * uy + b * vy));
    windowsOf(page.cells).forEach((reach, i) => {
      const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([a, b]) => corner(reach, a, b));
      if (i === 0) cased(outline(corners), '#ffb627', 1.8);
      else { c.beginPath(); outline(corners)(); c.strokeStyle = `rgb(255 182 39 / ${.75 / i})`; c.lineWidth = 1; c.stroke(); }
    });
    const [u, v] = row.gaze;
    for (const [au, av] of detail?.also || []) cross(...at(x + (au - u) * ux + (av - v) * vx, y + (au - u) * uy + (av - v) * vy), 5, '#ffb627');
    cross(...at(x, y), 8, '#ffffff');
  }
  if (byId('measuring').open && shows('scale')) paintScene(c, at);
  if (hand && page.draft) {
    const { x, y, w, h } = page.draft;
    cased(() => c.rect(...edge(x, y), k * w, k * h), '#ffffff', 2, [6, 4]);
  }
}

// Goes to a frame: its picture, what is known of it, and all panels.
let wanted = 0;
async function show(frame) {
  const call = ++wanted, video = page.video;
  const to = Math.max(1, Math.min(frame, page.ends));
  if (to !== page.frame && page.draft) setDraft(null);
  page.frame = to;
  transport();
  try {
    const [picture] = await Promise.all([pictureOf(page.frame), detailOf(page.frame)]);
    if (call !== wanted || video !== page.video) return;
    shown = { picture, frame: page.frame };
  } catch (error) {
    // A container's number of frames is an estimate: here is the end.
    if (page.frame > 1 && /no such frame/.test(error.message)) {
      page.ends = page.frame - 1;
      video.over = true;
      return show(page.ends);
    }
    throw error;
  }
  drawStage();
  panels();
}

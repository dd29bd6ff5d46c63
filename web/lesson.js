// The second tab: digit scenes, a policy that learns, and beside it a fixed centre and random gazes on the same frames.
const SCENES = {
  glimpse: { hidden: ['Bars', 4, 2, v => `${v}`], noise: 30, policy: 'gp-ucb', digit: 2, about: 'The second experiment of the paper by much smaller looks: 25 of the 784 pixels of the box. Few regions of the digit show where it is. The policy learns which; the centre and most random gazes see little.' },
  'close-up': { hidden: ['Hidden middle', 12, 0, v => `${v} of 28`], noise: 30, policy: 'gp-ucb', digit: 0, about: 'A digit twice as large, seen through a window of 8/28 of its box. The middle of a 0 is empty: a fixed centre sees little of it. Random gazes see more: compare with them, too.' },
  clutter: { hidden: ['Other digits', 36, 18, v => `${v}`], noise: 0, policy: 'hedge', digit: 3, about: 'The first experiment of the paper: one digit moves among others. Nine windows see most of it, so that a fixed centre does well.' },
  bars: { hidden: ['Bars', 4, 2, v => `${v}`], noise: 30, policy: 'gp-ucb', digit: 3, about: 'The second experiment of the paper: noise, and bars that hide the digit; one small look a frame.' },
};
const lesson = { thread: null, about: null, rows: [], now: null, playing: false, busy: false, seed: 7, gazes: [], template: null, eye: null };
const numeric = id => +byId(id).value;

for (const name of ['fixed', 'random', 'circular', 'hedge', 'exp3', 'exp3-ix', 'exp3-s', 'gp-ucb', 'pool', 'anchor']) byId('l-policy').append(element('option', { value: name }, name));
for (let digit = 0; digit < 10; digit++) byId('l-digit').append(element('option', { value: digit }, String(digit)));
function fitScene() {
  const { hidden: [name, most, usual], noise, policy, digit, about } = SCENES[byId('l-kind').value];
  byId('l-hidden-name').textContent = name;
  Object.assign(byId('l-hidden'), { max: most, value: usual });
  byId('l-noise').value = noise;
  byId('l-policy').value = policy;
  byId('l-digit').value = digit;
  byId('l-about').textContent = about;
}
function sayScene() {
  byId('l-noise-says').textContent = `${numeric('l-noise')} %`;
  byId('l-hidden-says').textContent = SCENES[byId('l-kind').value].hidden[3](numeric('l-hidden'));
}
fitScene();
sayScene();

async function lessonBegin() {
  lesson.thread ||= threadOf();
  const scene = { kind: byId('l-kind').value, digit: numeric('l-digit'), noise: numeric('l-noise') / 100, hidden: numeric('l-hidden'), seed: lesson.seed };
  const about = await lesson.thread('ask', { message: { op: 'lesson', scene, policy: byId('l-policy').value } });
  Object.assign(lesson, { about, rows: [], now: null, gazes: [], truth: about.row.box, row: about.row, ended: false });
  lesson.picture = await lessonPicture();
  lesson.template = lesson.picture;
  lesson.eye = eyeOf(about.cells);
  lessonDraw();
}
const lessonPicture = () => lesson.thread('picture', { session: 0, frame: 1, width: lesson.about.width, height: lesson.about.height });
async function lessonStep() {
  const shown = await lesson.thread('ask', { message: { op: 'lesson_step' } });
  if (shown.ended) { lesson.ended = true; return; }
  const picture = await lessonPicture();
  if (lesson.picture !== lesson.template) lesson.picture.close();
  Object.assign(lesson, { picture, now: shown, truth: shown.truth });
  lesson.rows.push([shown.learning.error, shown.fixed.error, shown.random.error]);
  if (shown.learning.row.gaze) lesson.gazes.push(shown.learning.row.gaze);
  lessonDraw();
}
// One at a time: a scene that is being drawn, or a frame that is being tracked.
async function lessonDo(work) {
  while (lesson.busy) await new Promise(done => setTimeout(done, 5));
  lesson.busy = true;
  try { await work(); } finally { lesson.busy = false; }
}
async function lessonPlay() {
  if (lesson.playing) return;
  if (lesson.ended) await lessonDo(lessonBegin);
  lesson.playing = true;
  lessonTransport();
  try {
    while (lesson.playing && !lesson.ended) {
      const began = performance.now();
      await lessonDo(lessonStep);
      await new Promise(done => setTimeout(done, Math.max(0, 33 - (performance.now() - began))));
    }
  } finally { lesson.playing = false; lessonTransport(); }
}
function lessonPause() { lesson.playing = false; lessonTransport(); }
function lessonTransport() {
  byId('l-play').replaceChildren(drawing(lesson.playing ? icons.pause : icons.play), lesson.playing ? 'Pause' : 'Play');
  byId('l-play').setAttribute('aria-label', lesson.playing ? 'Pause' : 'Play');
  byId('l-state').textContent = lesson.playing ? '' : lesson.ended ? 'The scene has ended. Press Play to run it again, or choose another scene.'
    : lesson.rows.length ? 'Paused. Press Play to go on.' : 'Press Play: the trackers start from the dashed box in frame 1.';
}
async function lessonShown() {
  if (!lesson.about) await lessonDo(lessonBegin);
  else lessonDraw();
  lessonTransport();
}
const lessonAnew = doing(async () => { sayScene(); await lessonDo(lessonBegin); if (!lesson.playing) lessonPlay(); });
byId('l-kind').addEventListener('change', () => { fitScene(); lessonAnew(); });
for (const id of ['l-policy', 'l-digit', 'l-noise', 'l-hidden']) byId(id).addEventListener('change', lessonAnew);
for (const id of ['l-noise', 'l-hidden']) byId(id).addEventListener('input', sayScene);
byId('l-play').addEventListener('click', doing(() => lesson.playing ? lessonPause() : lessonPlay()));
byId('l-step').addEventListener('click', doing(async () => { lessonPause(); await lessonDo(lessonStep); }));
byId('l-again').addEventListener('click', lessonAnew);
byId('l-other').addEventListener('click', () => { lesson.seed++; lessonAnew(); });
document.addEventListener('keydown', event => {
  if (byId('lesson').hidden || event.ctrlKey || event.metaKey || event.altKey || event.target.matches('select, input, button, a, summary')) return;
  if (event.key === ' ') doing(() => lesson.playing ? lessonPause() : lessonPlay())();
  else if (event.key === '.') byId('l-step').click();
  else return;
  event.preventDefault();
});
window.addEventListener('resize', () => { if (!byId('lesson').hidden && lesson.about) lessonDraw(); });
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => { if (!byId('lesson').hidden && lesson.about) lessonDraw(); });

function lessonDraw() {
  const { about, now } = lesson, frame = now ? now.learning.row.frame : 1;
  byId('l-clock').replaceChildren('frame ', element('b', {}, String(frame)), ` of ${about.frames}`);
  drawScene();
  drawLearned();
  drawGlimpse(byId('l-seen'), lesson.eye, now ? bytes(now.learning.detail.glimpse) : []);
  drawErrors();
}
function drawScene() {
  const { about, now } = lesson, canvas = byId('l-screen'), k = Math.min(byId('l-holder').clientWidth / about.width, Math.max(200, .62 * window.innerHeight) / about.height);
  const [width, height] = [Math.floor(k * about.width), Math.floor(k * about.height)];
  canvas.style.width = width + 'px';
  canvas.style.height = height + 'px';
  const c = sharp(canvas, width, height), at = (x, y) => [k * (x + .5), k * (y + .5)];
  c.imageSmoothingEnabled = false;
  c.drawImage(lesson.picture, 0, 0, width, height);
  c.lineJoin = c.lineCap = 'round';
  const { cased, outline, cross } = penOf(c);
  const corners = row => outline(row.corners.map(([x, y]) => at(x, y)));
  if (!now) return cased(corners(lesson.row), '#ffffff', 2, [6, 4]);
  drawCloud(c, now.learning.detail, [about.width, about.height], at, k);
  cased(corners(now.random.row), '#dd8fb8', 2, [2, 4]);
  cased(corners(now.fixed.row), '#3fd19b', 2, [6, 5]);
  cased(corners(now.learning.row), '#39b6ff', 2);
  const { fixation: [x, y, ux, uy, vx, vy], gaze: [u, v] } = now.learning.row;
  windowsOf(about.cells).forEach((reach, i) => {
    const place = ([a, b]) => at(x + reach * (a * ux + b * vx), y + reach * (a * uy + b * vy));
    cased(outline([[-1, -1], [1, -1], [1, 1], [-1, 1]].map(place)), i ? 'rgb(255 182 39 / .6)' : '#ffb627', i ? 1 : 1.8);
  });
  for (const [au, av] of now.learning.detail.also) cross(...at(x + (au - u) * ux + (av - v) * vx, y + (au - u) * uy + (av - v) * vy), 4, '#ffb627');
  cross(...at(x, y), 7, '#ffffff');
}
// What the policy has learned, on the target as it was in frame 1.
function drawLearned() {
  const { now, template, about } = lesson, canvas = byId('l-template'), size = canvas.clientWidth || 200, c = sharp(canvas, size, size), [left, top, wide, high] = about.row.box;
  const at = v => size * (.5 + v / 2.4), surface = now?.learning.surface, arms = now?.learning.detail.arms || [], row = now?.learning.row;
  c.fillStyle = '#08090b';
  c.fillRect(0, 0, size, size);
  c.imageSmoothingEnabled = false;
  c.globalAlpha = arms.length ? .55 : 1;
  c.drawImage(template, left, top, wide, high, at(-1), at(-1), at(1) - at(-1), at(1) - at(-1));
  c.globalAlpha = 1;
  if (surface) {
    const { side, mean, reach } = surface, low = Math.min(...mean), most = Math.max(...mean), made = new OffscreenCanvas(side, side), m = made.getContext('2d'), pixels = m.createImageData(side, side);
    mean.forEach((v, i) => pixels.data.set([...tint((v - low) / Math.max(1e-12, most - low)), 255], 4 * i));
    m.putImageData(pixels, 0, 0);
    const half = (at(reach) - at(-reach)) / (side - 1) / 2;
    c.save();
    c.beginPath(); c.rect(at(-reach), at(-reach), at(reach) - at(-reach), at(reach) - at(-reach)); c.clip();
    c.globalAlpha = .62;
    c.imageSmoothingEnabled = true;
    c.drawImage(made, at(-reach) - half, at(-reach) - half, at(reach) - at(-reach) + 2 * half, at(reach) - at(-reach) + 2 * half);
    c.restore();
  }
  c.strokeStyle = '#39b6ff'; c.lineWidth = 1.5;
  c.strokeRect(at(-1), at(-1), at(1) - at(-1), at(1) - at(-1));
  if (!arms.length) for (const [u, v] of lesson.gazes.slice(-100)) {
    c.beginPath(); c.arc(at(u), at(v), 1.9, 0, 7); c.fillStyle = '#fff'; c.fill(); c.strokeStyle = 'rgb(0 0 0 / .6)'; c.lineWidth = .8; c.stroke();
  }
  for (const [u, v, p] of arms) {
    c.beginPath(); c.arc(at(u), at(v), Math.max(2, .09 * size * Math.sqrt(p)), 0, 7); c.fillStyle = 'rgb(120 205 255 / .85)'; c.fill(); c.strokeStyle = 'rgb(0 0 0 / .5)'; c.lineWidth = 1; c.stroke();
  }
  if (surface?.best) for (const [ink, thick] of [['#000', 4.5], ['#fff', 2]]) { c.beginPath(); c.arc(at(surface.best[0]), at(surface.best[1]), 7, 0, 7); c.strokeStyle = ink; c.lineWidth = thick; c.stroke(); }
  if (row?.gaze) {
    const [x, y] = row.gaze.map(at);
    for (const [ink, thick] of [['#000', 4.5], ['#ffb627', 2]]) { c.strokeStyle = ink; c.lineWidth = thick; c.beginPath(); c.moveTo(x - 6, y); c.lineTo(x + 6, y); c.moveTo(x, y - 6); c.lineTo(x, y + 6); c.stroke(); }
  }
  byId('l-caption').textContent = surface ? 'reward of each gaze, brighter is more; ring: the best' : arms.length ? 'area of a disc: probability of the gaze' : 'the target; dots: where it looked';
  byId('l-reward').replaceChildren(...(now ? ['reward of this look ', element('b', {}, say(now.learning.reward, 3))] : []));
  byId('l-arms').replaceChildren(...armRows(arms, row?.gaze));
}
function drawErrors() {
  const canvas = byId('l-graph'), width = canvas.clientWidth, height = canvas.clientHeight, { rows, about } = lesson;
  if (!width) return;
  const off = about.row.box[2] / 2, high = Math.min(4 * off, 2 * Math.ceil(Math.max(2, .55 * Math.max(0, ...rows.flat()))));
  const c = sharp(canvas, width, height), x = i => (i + .5) / about.frames * width, y = e => 2 + (1 - Math.min(1, e / high)) * (height - 4);
  c.clearRect(0, 0, width, height);
  const line = (points, ink, thick, dash = []) => { c.beginPath(); points.forEach((p, i) => i ? c.lineTo(...p) : c.moveTo(...p)); c.setLineDash(dash); c.strokeStyle = ink; c.lineWidth = thick; c.stroke(); c.setLineDash([]); };
  line([[0, height - .5], [width, height - .5]], colour('line'), 1);
  if (off < high) line([[0, y(off)], [width, y(off)]], colour('soft'), 1, [2, 4]);
  line(rows.map((row, i) => [x(i), y(row[2])]), colour('third'), 1.8, [2, 4]);
  line(rows.map((row, i) => [x(i), y(row[1])]), colour('second'), 1.8, [6, 4]);
  line(rows.map((row, i) => [x(i), y(row[0])]), colour('target'), 1.8);
  byId('l-axis').replaceChildren(...[high, high / 2, 0].map(v => element('span', {}, String(Math.round(v)))));
  const mean = which => say(rows.reduce((sum, row) => sum + row[which], 0) / rows.length, 2);
  const means = rows.length ? [[about.policy, 'swatch k-learning', 0], ['fixed centre', 'swatch dash k-fixed', 1], ['random gazes', 'swatch dash k-random', 2]] : [];
  byId('l-means').replaceChildren(...means.map(([name, swatch, which]) => element('span', {}, element('i', { class: swatch }), `${name}: mean `, element('b', {}, mean(which)))));
  canvas.setAttribute('aria-label', rows.length ? `Error in ${counted(rows.length, 'frame')}: ${means.map(([name, , which]) => `${name} ${mean(which)} pixels on average`).join(', ')}` : 'Error of the three trackers over time');
}

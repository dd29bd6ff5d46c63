// The page: what was run, the transport, and one `show` that everything follows.
let now = 0, playing = false, rate = 1;
const nearestKey = row => {
  let low = 0, high = keys.length - 1;
  while (low < high) { const middle = (low + high + 1) >> 1; if (keys[middle].row <= row) low = middle; else high = middle - 1; }
  return low + 1 < keys.length && keys[low + 1].row - row < row - keys[low].row ? low + 1 : low;
};

function show(k) {
  now = Math.min(keys.length - 1, Math.max(0, k));
  const row = keys[now].row, scrub = byId('scrub');
  scrub.value = now;
  scrub.setAttribute('aria-valuetext', `frame ${series.frame[row]}`);
  byId('clock').replaceChildren('frame ', element('b', {}, String(series.frame[row])), ` of ${series.frame[rows - 1]} · ${series.time[row].toFixed(2)} s`);
  drawStage();
  drawFovea();
  drawPolicy();
  drawFilm();
  moveCursors();
}

// Transport.
const icons = { play: '<svg viewBox="0 0 16 16"><path d="M4 2.5v11l9.5-5.5z"/></svg>', pause: '<svg viewBox="0 0 16 16"><path d="M3.5 2.5h3.2v11H3.5zM9.3 2.5h3.2v11H9.3z"/></svg>' };
let before = 0, due = 0, touched = false;
function play() {
  if (playing || keys.length < 2) return;
  if (!touched || now === keys.length - 1) show(0);
  playing = touched = true; before = performance.now(); due = 0;
  button();
  requestAnimationFrame(tick);
}
function pause() { touched = true; if (playing) { playing = false; button(); } }
function button() {
  byId('play').replaceChildren(drawing(playing ? icons.pause : icons.play));
  byId('play').setAttribute('aria-label', playing ? 'Pause' : 'Play');
}
function tick(time) {
  if (!playing) return;
  due += rate * Math.max(0, time - before) / 1000;
  before = time;
  let next = now;
  const lasts = k => Math.max(.004, series.time[keys[k + 1].row] - series.time[keys[k].row]);
  while (next + 1 < keys.length && due >= lasts(next)) { due -= lasts(next); next++; }
  if (next !== now) show(next);
  if (now === keys.length - 1) pause(); else requestAnimationFrame(tick);
}
const rates = [.1, .25, .5, 1, 2, 4, 8];
byId('speed').append(...rates.map(r => element('option', { value: r }, `${r}×`)));
const faster = by => { rate = rates[Math.min(rates.length - 1, Math.max(0, rates.indexOf(rate) + by))]; byId('speed').value = rate; };
byId('speed').addEventListener('change', event => { rate = +event.target.value; });
byId('scrub').max = keys.length - 1;
byId('scrub').addEventListener('input', event => { pause(); show(+event.target.value); });
byId('play').addEventListener('click', () => playing ? pause() : play());
byId('back').addEventListener('click', () => { pause(); show(now - 1); });
byId('forth').addEventListener('click', () => { pause(); show(now + 1); });
document.addEventListener('keydown', event => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === 'SELECT') return;
  const onButton = document.activeElement?.matches('button, summary, input[type=checkbox]');
  const go = { ArrowLeft: () => show(now - (event.shiftKey ? 10 : 1)), ArrowRight: () => show(now + (event.shiftKey ? 10 : 1)), Home: () => show(0), End: () => show(keys.length - 1) }[event.key];
  const layer = layers.find(l => l.key === event.key);
  if (go) { pause(); go(); }
  else if (event.key === ' ' && !onButton) { if (playing) pause(); else play(); }
  else if (event.key === '+' || event.key === '=') faster(1);
  else if (event.key === '-') faster(-1);
  else if (layer) layer.box.click();
  else return;
  event.preventDefault();
});

// Under the scrubber: the whole run, lost stretches raised.
function drawMarks() {
  const canvas = byId('marks'), w = canvas.clientWidth, c = sharp(canvas, w, 32);
  c.clearRect(0, 0, w, 32);
  c.fillStyle = colour('line'); c.beginPath(); c.roundRect(0, 14, w, 4, 2); c.fill();
  c.fillStyle = colour('lost');
  for (const [a, b] of lostRuns) c.fillRect(7 + a / rows * (w - 14), 12, Math.max(2, (b - a + 1) / rows * (w - 14)), 8);
}

// Words.
function write() {
  const steps = series.ess.filter(e => e !== null).length, lost = series.lost.filter(Boolean).length;
  const name = info.source.split(/[\\/]/).filter(Boolean).pop() || info.source;
  byId('source').textContent = name;
  byId('verdict').textContent = steps === 0 ? 'One frame: the given box.'
    : lost === 0 ? `Followed through ${rows} frames and never believed lost.`
    : `Followed through ${rows} frames; believed lost on ${lost} of them, first at frame ${series.frame[lostRuns[0][0]]}.`;
  if (data.classes) byId('verdict').append(` Recognised as ${data.classes[0].name}, with probability ${say(data.classes[0].of[rows - 1], 2)}.`);
  const p = policyAt(keys.length - 1), best = p.indexOf(Math.max(...p));
  if (data.learned && arms.length > 1 && p[best] * arms.length > 2 && keys.some((_, k) => policyAt(k).some(q => q > .01 && q < .99))) byId('verdict').append(` By the end it looks at (${say(arms[best][0], 2)}, ${say(arms[best][1], 2)}) with probability ${p[best].toFixed(2)}.`);
  const every = keys.length > 1 ? keys[1].row - keys[0].row : 1;
  byId('about').textContent = [info.config_name, `${data.particles} particles`, `seed ${info.seed}`, info.reader, keys.length < rows && `one frame in ${every} is shown here`].filter(Boolean).join(' · ');
  const tile = (value, unit, label) => element('div', {}, element('dt', {}, label), element('dd', {}, value, element('small', {}, unit)));
  const fps = data.summary.fps;
  byId('tiles').append(tile(String(rows), '', 'frames'), ...(fps ? [tile(fps >= 100 ? String(Math.round(fps)) : say(fps), 'frames/s', 'tracking speed')] : []),
    ...(known ? [tile(say(median(chartList.find(chart => chart.title === 'Error').lines[0].of)), 'px', 'median error')] : []), tile(say(steps ? 100 * lost / steps : 0, 2), '%', 'believed lost'), tile(say(median(series.ess)), `of ${data.particles}`, 'median ESS'));
  if (data.regret) {
    const last = rows - 1, { best, total, random, gazes } = data.regret;
    byId('verdict').append(` Of ${gazes} fixed gazes (${say(best[0], 2)}, ${say(best[1], 2)}) would have earned most: ${say(total[last])} more in all than it did; looking at random, ${say(random[last])} more.`);
  }
  const facts = [['Source', info.source], ['Read as', `${info.reader}, ${frameWidth} × ${frameHeight} px, ${say(data.rate)} frames/s`], ['Command', info.command], ['Configuration', info.config_name], ['Seed', String(info.seed)], ['Program', info.version]];
  if (keys.length < rows) facts.push(['This page', `shows ${keys.length} of ${rows} frames, one in ${every}, to stay small; the charts have all of them`]);
  if (data.shown < data.particles) facts.push(['Particles', `${data.shown} of ${data.particles} are drawn, evenly picked, and always the heaviest one`]);
  for (const [term, text] of facts) if (text) byId('facts').append(element('dt', {}, term), element('dd', {}, text));
  byId('config').textContent = info.config_text || '(none)';
  if (!info.config_text) byId('config').closest('details').hidden = true;

  const line = (shape, ...text) => element('p', {}, drawing(`<svg viewBox="0 0 26 20" aria-hidden="true">${shape}</svg>`), element('span', {}, ...text));
  const strong = text => element('b', {}, text);
  const keyboard = text => element('kbd', {}, text);
  byId('legend').append(
    line('<rect x="3" y="3" width="20" height="14" fill="none" stroke="var(--target)" stroke-width="2.2"/>', strong('Box and path. '), 'Where the target is believed to be: the mean of the particles, and where it came from. Dashed when believed lost.'),
    ...(known ? [line('<rect x="3" y="3" width="20" height="14" fill="none" stroke="var(--second)" stroke-width="2" stroke-dasharray="2 3"/>', strong('Truth. '), 'Where the target really is; the tracker does not know it.')] : []),
    line('<circle cx="6" cy="13" r="3" fill="#6f47e6"/><circle cx="13" cy="8" r="3.2" fill="#e0528f"/><circle cx="20" cy="12" r="3.6" fill="#f2c94c" stroke="#0005"/>', strong('Particles. '), 'Guesses of where it might be. Violet: light, explains little; yellow: heavy, explains the frame best.'),
    line('<ellipse cx="13" cy="10" rx="10" ry="6.5" fill="none" stroke="currentColor" stroke-dasharray="2.5 2.5" stroke-width="1.5"/>', strong('Uncertainty. '), 'Where the centre is with a probability of 90 %.'),
    line('<rect x="6" y="3" width="14" height="14" fill="none" stroke="var(--gaze)" stroke-width="2"/><path d="M13 6.5v7M9.5 10h7" stroke="currentColor" stroke-width="1.8"/>', strong('Fixation. '), 'The cross is where it looked in this frame; the squares are the windows of its retina, sharp inside and coarse outside.'),
    line('<rect x="2" y="2" width="10" height="16" fill="var(--darker)" opacity=".75"/><rect x="14" y="2" width="10" height="16" fill="var(--brighter)" opacity=".75"/>', strong('Seen and remembered. '), 'All that it takes from the frame, beside the first frame at the same gaze. The less colour in the difference, the better the match.'),
    line('<circle cx="8" cy="10" r="6.5" fill="var(--target)" opacity=".75"/><circle cx="20" cy="10" r="3" fill="var(--target)" opacity=".75"/>', strong('Policy. '), 'How likely each point of the target is to be looked at next. It grows where looks were rewarded: where they told most about the position.'),
    ...(data.surface ? [line('<rect x="3" y="2" width="20" height="16" fill="#6f47e6"/><circle cx="15" cy="9" r="6" fill="#e0528f"/><circle cx="16" cy="8" r="3" fill="#ffec82"/>', strong('Reward surface. '), 'What it believes each gaze to be worth, learned from the looks so far, and how unsure it is. The scales hold for the whole run. Move over it to read values.')] : []),
    ...(data.regret ? [line('<path d="M2 17L24 4" fill="none" stroke="var(--soft)" stroke-dasharray="3 2" stroke-width="1.6"/><path d="M2 17q6 -8 22 -8" fill="none" stroke="var(--gaze)" stroke-width="1.8"/>', strong('Regret. '), 'What the best fixed gaze in hindsight would have earned beyond what was earned, all under the belief of this run. Flat is good: nothing more is lost.')] : []),
    line('<path d="M2 15l5-8 5 4 6-8 6 5" fill="none" stroke="var(--target)" stroke-width="1.8"/>', strong('Effective sample size. '), 'How many particles share the weight. Few: sure, or wrong in one place; all of them: the look told nothing.'),
    line('<rect x="3" y="2" width="20" height="16" fill="var(--lostwash)"/><rect x="3" y="15.5" width="20" height="2.5" fill="var(--lost)"/>', strong('Evidence, P(lost). '), 'Evidence says how well the frame was foreseen. Doubt compares it with what the first frame promised; P(lost) is the probability that the box is off the target, fitted on videos with truth. Shaded stretches are believed lost.'),
    line('<rect x="3" y="4" width="20" height="12" rx="2.5" fill="none" stroke="currentColor" stroke-opacity=".6"/><path d="M7 12h12M7 8h2M12 8h2M17 8h2" stroke="currentColor" stroke-opacity=".6" stroke-width="1.4"/>', strong('Keys. '), keyboard('space'), ' plays, ', keyboard('←'), ' ', keyboard('→'), ' step (', keyboard('shift'), ' by ten), ', keyboard('+'), ' ', keyboard('−'), ' speed, ', ...layers.flatMap(l => [keyboard(l.key), ` ${l.label} `]), '. Moving over any chart moves the replay.'),
  );
}

function layout() { drawCharts(); drawMarks(); developFilm(); show(now); }
function fromAddress() {
  const wish = /frame=(\d+)/.exec(location.hash);
  // The page opens in the midst of the run, where there is something to see; play begins at the beginning.
  if (!wish) return show(Math.floor(keys.length * .4));
  touched = true;
  const row = series.frame.findIndex(f => f >= +wish[1]);
  show(nearestKey(row < 0 ? rows - 1 : row));
}
write();
faster(0);
button();
layout();
fromAddress();
let asked = 0;
new ResizeObserver(() => { cancelAnimationFrame(asked); asked = requestAnimationFrame(layout); }).observe(document.querySelector('main'));
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', layout);
window.addEventListener('hashchange', fromAddress);

// The page: what was run, and one `draw` that everything follows.
const nearestKey = row => {
  let low = 0, high = keys.length - 1;
  while (low < high) { const middle = (low + high + 1) >> 1; if (keys[middle].row <= row) low = middle; else high = middle - 1; }
  return low + 1 < keys.length && keys[low + 1].row - row < row - keys[low].row ? low + 1 : low;
};
const { show, pause, open: openReplay } = transport({
  count: keys.length,
  // Where most targets are, in the midst of the run.
  first: (middle => keys.reduce((best, key, k) => {
    const more = key.targets.length - keys[best].targets.length;
    return more > 0 || more === 0 && Math.abs(k - middle) < Math.abs(best - middle) ? k : best;
  }, 0))(Math.floor(keys.length * .4)),
  lasts: k => series.time[keys[k + 1].row] - series.time[keys[k].row],
  find(frame) { const row = series.frame.findIndex(f => f >= frame); return nearestKey(row < 0 ? rows - 1 : row); },
  key(name) { const layer = layers.find(l => l.key === name); layer?.box.click(); return layer; },
  draw() {
    const row = keys[now].row;
    byId('scrub').setAttribute('aria-valuetext', `frame ${series.frame[row]}`);
    byId('clock').replaceChildren('frame ', element('b', {}, String(series.frame[row])), ` of ${series.frame[rows - 1]} · ${viewed ? `${series.time[row].toFixed(2)} s` : counted(keys[now].targets.length, 'target')}`);
    drawStage();
    if (viewed) drawFovea();
    drawPolicy();
    drawFilm();
    moveCursors();
  },
});

// On the rail of the scrubber: where the target was occluded or lost.
function drawMarks() {
  const canvas = byId('marks'), { clientWidth: w, clientHeight: h } = canvas, c = sharp(canvas, w, h);
  c.clearRect(0, 0, w, h);
  c.fillStyle = colour('lost');
  for (const [a, b] of lostRuns) c.fillRect(7 + a / rows * (w - 14), h / 2 - 4, Math.max(2, (b - a + 1) / rows * (w - 14)), 8);
}

// Words.
function write() {
  const steps = series.usable.filter(usable => usable !== null).length, lost = series.usable.filter(usable => usable === 0).length;
  const followed = viewed ? rows : steps + 1;
  const name = info.source.split(/[\\/]/).filter(Boolean).pop() || info.source;
  byId('source').textContent = name;
  for (const warning of info.warnings) document.querySelector('main').before(element('p', { class: 'message' }, warning));
  const { targets, most, reidentified } = data.tracks;
  byId('verdict').textContent = !viewed && targets !== 1 ? `${counted(targets, 'target')} in ${counted(rows, 'frame')}, at most ${most} at a time, ${reidentified} re-identified.`
    : steps === 0 ? 'One frame: the given box.'
    : lost === 0 ? `Tracked over ${counted(followed, 'frame')}, never occluded or lost.`
    : `Tracked over ${counted(followed, 'frame')}, occluded or lost in ${lost} of them, first in frame ${series.frame[lostRuns[0][0]]}.`;
  if (data.classes) byId('verdict').append(` Recognised as ${data.classes[0].name}, with probability ${say(data.classes[0].of[rows - 1], 2)}.`);
  const p = keys.length ? policyAt(keys.length - 1) : [], best = p.indexOf(Math.max(...p));
  if (data.learned && arms.length > 1 && p[best] * arms.length > 2 && keys.some((_, k) => policyAt(k).some(q => q > .01 && q < .99))) byId('verdict').append(` At the end the policy prefers the gaze (${say(arms[best][0], 2)}, ${say(arms[best][1], 2)}) with probability ${p[best].toFixed(2)}.`);
  const every = keys.length > 1 ? keys[1].row - keys[0].row : 1;
  byId('about').textContent = [info.config_name, viewed && counted(data.particles, 'particle'), `seed ${info.seed}`, info.reader, keys.length < rows && `one frame in ${every} is shown here`].filter(Boolean).join(' · ');
  const tile = (value, unit, label) => element('div', {}, element('dt', {}, label), element('dd', {}, value, element('small', {}, unit)));
  const fps = data.summary.fps;
  byId('tiles').append(tile(String(rows), '', 'frames'), ...(fps ? [tile(fps >= 100 ? String(Math.round(fps)) : say(fps), 'frames/s', 'tracking speed')] : []),
    ...(known ? [tile(say(median(chartList.find(chart => chart.title === 'Centre error').lines[0].of)), 'px', 'median centre error')] : []), ...(viewed ? [tile(say(100 * lost / steps, 2), '%', 'occluded or lost'), tile(say(median(series.ess)), `of ${data.particles}`, 'median ESS')] : []));
  if (data.regret) {
    const last = rows - 1, { best, total, random, gazes } = data.regret;
    byId('verdict').append(` Of ${gazes} fixed gazes, (${say(best[0], 2)}, ${say(best[1], 2)}) has the largest reward: regret ${say(total[last])}, against ${say(random[last])} of a uniform random policy.`);
  }
  const facts = [['Source', info.source], ['Read as', `${info.reader}, ${frameWidth} × ${frameHeight} px${data.rate ? `, ${say(data.rate)} frames/s` : ''}`], ['Command', info.command], ['Configuration', info.config_name], ['Seed', String(info.seed)], ['Program', info.version]];
  if (keys.length < rows) facts.push(['This page', `shows ${keys.length} of ${counted(rows, 'frame')}, one in ${every}, to stay small; the charts have all of them`]);
  if (data.shown < data.particles) facts.push(['Particles', `${data.shown} of ${data.particles} are drawn, evenly picked, and always the heaviest one`]);
  for (const [term, text] of facts) if (text) byId('facts').append(element('dt', {}, term), element('dd', {}, text));
  byId('config').textContent = info.config_text || '(none)';
  if (!info.config_text) byId('config').closest('details').hidden = true;

  const line = (shape, ...text) => element('p', {}, drawing(`<svg viewBox="0 0 26 20" aria-hidden="true">${shape}</svg>`), element('span', {}, ...text));
  const strong = text => element('b', {}, text);
  const keyboard = text => element('kbd', {}, text);
  byId('legend').append(
    line('<path d="M6 2L24 6L20 18L2 14z" fill="none" stroke="var(--target)" stroke-width="2"/>', strong('Box and path. '), 'The reported box, turned by the estimated angle, and the last centres.'),
    line('<path d="M3 7V3h5M18 3h5v4M23 13v4h-5M8 17H3v-4" fill="none" stroke="var(--target)" stroke-width="2"/>', strong('Corners alone. '), 'The target is occluded or lost; its motion predicts the box.'),
    ...(known ? [line('<rect x="3" y="3" width="20" height="14" fill="none" stroke="var(--second)" stroke-width="2" stroke-dasharray="2 3"/>', strong('Truth. '), 'The true box; the tracker does not know it.')] : []),
    ...data.baselines.map(({ name }, i) => line(`<rect x="3" y="3" width="20" height="14" fill="none" stroke="var(--${['baseline', 'third'][i]})" stroke-width="2.2"/>`, strong(`${name[0].toUpperCase()}${name.slice(1)}. `), 'The box of another tracker on the same frames; dashed in the chart of the centre error.')),
    ...(viewed ? [line('<circle cx="6" cy="13" r="3" fill="#6f47e6"/><circle cx="13" cy="8" r="3.2" fill="#e0528f"/><circle cx="20" cy="12" r="3.6" fill="#f2c94c" stroke="#0005"/>', strong('Particles. '), 'Samples of the predicted state. Violet: small weight; yellow: large weight.')] : []),
    ...(viewed ? [line('<ellipse cx="13" cy="10" rx="10" ry="6.5" fill="none" stroke="currentColor" stroke-dasharray="2.5 2.5" stroke-width="1.5"/>', strong('Uncertainty. '), 'The 90 % credible region of the centre.')] : []),
    viewed ? line('<rect x="6" y="3" width="14" height="14" fill="none" stroke="var(--gaze)" stroke-width="2"/><path d="M13 6.5v7M9.5 10h7" stroke="currentColor" stroke-width="1.8"/>', strong('Gaze. '), 'The cross is the chosen gaze of this frame; the squares are the windows of the retina, fine inside and coarse outside.')
      : line('<path d="M13 3v14M6 10h14" stroke="var(--target)" stroke-width="2"/>', strong('Cross. '), 'The gaze: where the retina reads the target in this frame.'),
    ...(viewed ? [] : [
      line('<rect x="1" y="4" width="24" height="13" rx="2" fill="currentColor"/><text x="13" y="14" text-anchor="middle" font-size="9" fill="var(--card)">id 1</text>', strong('Label. '), 'The track id; with a recogniser also the class and its probability.'),
      line('<rect x="1" y="4" width="24" height="12" rx="1.5" fill="var(--target)"/>', strong('Full bar. '), 'Tracked, from its initiation on.'),
      line('<rect x="1" y="4" width="24" height="12" rx="1.5" fill="var(--target)" opacity=".4"/>', strong('Pale bar. '), 'Occluded by another target.'),
      line('<rect x="1" y="8.5" width="24" height="3" rx="1.5" fill="var(--target)" opacity=".75"/>', strong('Thin line. '), 'Lost: the box is a guess.'),
      line('<rect x="1" y="4" width="6" height="12" rx="1.5" fill="var(--target)"/><rect x="17" y="4" width="8" height="12" rx="1.5" fill="var(--target)"/><circle cx="17" cy="10" r="4" class="again"/>', strong('Gap and ring. '), 'Terminated, and re-identified later under the same id.'),
    ]),
    ...(viewed ? [line('<rect x="2" y="2" width="10" height="16" fill="var(--darker)" opacity=".75"/><rect x="14" y="2" width="10" height="16" fill="var(--brighter)" opacity=".75"/>', strong('Glimpse. '), 'What the retina reads from the frame, beside the template at the same gaze. The less colour in the difference, the better the match.')] : []),
    ...(fixed || data.surface ? [] : [line('<circle cx="8" cy="10" r="6.5" fill="var(--target)" opacity=".75"/><circle cx="20" cy="10" r="3" fill="var(--target)" opacity=".75"/>', strong('Gaze policy. '), 'How probable each gaze is. It grows where the reward was large: where the glimpse was most informative about the state.')]),
    ...(data.surface ? [line('<rect x="3" y="2" width="20" height="16" fill="#6f47e6"/><circle cx="15" cy="9" r="6" fill="#e0528f"/><circle cx="16" cy="8" r="3" fill="#ffec82"/>', strong('Reward surface. '), 'Mean reward of each gaze, learned from the gazes so far, and its standard deviation. The scales hold for the whole run. Move over it to read values.')] : []),
    ...(data.regret ? [line('<path d="M2 17L24 4" fill="none" stroke="var(--soft)" stroke-dasharray="3 2" stroke-width="1.6"/><path d="M2 17q6 -8 22 -8" fill="none" stroke="var(--gaze)" stroke-width="1.8"/>', strong('Regret. '), 'Reward of the best fixed gaze in hindsight less that of the policy, summed, all under the belief of this run. Flat: nothing more is lost.')] : []),
    ...(viewed ? [line('<path d="M2 15l5-8 5 4 6-8 6 5" fill="none" stroke="var(--target)" stroke-width="1.8"/>', strong('Effective sample size. '), 'How many particles share the weight. Few: a peaked belief; all of them: the glimpse was uninformative.')] : []),
    ...(viewed ? [line('<path d="M2 16C9 16 10 4 16 5s5 8 8 9" fill="none" stroke="var(--lost)" stroke-width="1.8"/>', strong('Evidence, P(lost). '), 'Log evidence is how well the frame was predicted. P(lost) is the probability that the target is lost, and the status follows from it.')] : []),
    ...(viewed ? [line('<rect x="3" y="2" width="20" height="16" fill="var(--lostwash)"/><rect x="3" y="15.5" width="20" height="2.5" fill="var(--lost)"/>', strong('Shaded frames. '), 'The status is occluded or lost: do not use the box.')] : []),
    line('<rect x="3" y="4" width="20" height="12" rx="2.5" fill="none" stroke="currentColor" stroke-opacity=".6"/><path d="M7 12h12M7 8h2M12 8h2M17 8h2" stroke="currentColor" stroke-opacity=".6" stroke-width="1.4"/>', strong('Keys. '), keyboard('space'), ' plays, ', keyboard('←'), ' ', keyboard('→'), ' step (', keyboard('shift'), ' by ten), ', keyboard('+'), ' ', keyboard('−'), ' speed, ', ...layers.flatMap((l, i) => [keyboard(l.key), ` ${l.label}${i + 1 < layers.length ? ' ' : ''}`]), chartList.length ? '. Moving over any chart moves the replay.' : '.'),
  );
}

function layout() { drawCharts(); drawMarks(); developFilm(); show(now); }
write();
layout();
openReplay();
let asked = 0;
new ResizeObserver(() => { cancelAnimationFrame(asked); asked = requestAnimationFrame(layout); }).observe(document.querySelector('main'));
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', layout);

// The card that measures: asks for the numbers while a target is tracked, and shows them.
// `times` are those of the last answer: a failed one does not change them.
const measuring = { answer: null, times: [], problem: '', key: '', busy: false, next: 0, took: 0 };
const FEWEST = 5;   // positions that a measurement needs
const REASONS = { lost: 'it may be lost', region: 'its position is uncertain', leap: 'its position leaps' };
const MAIN = { line: 'v', sine: 'T', damped: 'T', exponential: 'tau', drag: 'v_end' };
const wordOf = id => byId(id).value.trim(), withError = (value, error) => error ? `${value}+-${error}` : value;
// The mean interval of the points, and a time to a hundredth of it.
const interval = () => (measuring.times.at(-1) - measuring.times[0]) / measuring.times.length;
const secondsOf = time => time.toFixed(Math.max(3, Math.ceil(2 - Math.log10(interval()))));
function measureOptions() {
  const options = {}, from1 = place => place.map(v => v + 1).join(','), curve = byId('fit-curve').value, range = [wordOf('fit-from'), wordOf('fit-to')], { times } = measuring;
  if (rulerLength() && wordOf('length')) options.ruler = `${from1(scene.ruler.flat())}=${withError(wordOf('length'), wordOf('length-error'))}${byId('length-unit').value}`;
  if (scene.origin) options.origin = from1(scene.origin);
  if (+wordOf('angle')) options.angle = wordOf('angle');
  if (wordOf('fps')) options.fps = withError(wordOf('fps'), wordOf('fps-error'));
  // An end that is not given is that of the track.
  if (range.some(Boolean) && times.length) range.forEach((end, i) => { range[i] = end || (i ? secondsOf(times.at(-1) + interval() / 100) : '0'); });
  if (curve) options.fit = `${curve}:${byId('fit-axis').value}${range.every(Boolean) ? ':' + range.join('-') : ''}`;
  return options;
}
const measureMessage = more => ({ op: 'measure', session: page.video.session, target: page.target, options: measureOptions(), ...more });
const measureKey = () => page.version + JSON.stringify(measureMessage());
// Measures again if the track or a setting has changed; while it tracks, for at most a fifth of the time and a second at once.
async function measureSoon() {
  // Another target, or one that starts again.
  if (measuring.answer && page.rows.length < FEWEST) { forgetAnswer(); drawMeasured(); }
  markTime();
  if (measuring.busy) return;
  measuring.busy = true;
  try {
    while (byId('measuring').open && page.rows.length >= FEWEST && measureKey() !== measuring.key) {
      if (page.playing && (performance.now() < measuring.next || measuring.took > 1000)) { await new Promise(done => setTimeout(done, 50)); continue; }
      const video = page.video, began = performance.now();
      measuring.key = measureKey();
      const [answer, problem] = await tracker.ask(measureMessage()).then(answer => [answer, ''], error => [null, error.message]);
      measuring.took = performance.now() - began;
      measuring.next = performance.now() + Math.max(400, 4 * measuring.took);
      if (video === page.video && page.rows.length >= FEWEST) { Object.assign(measuring, { answer, problem, times: answer?.times || measuring.times }); drawMeasured(); }
    }
  } finally { measuring.busy = false; }
}
function changed() {
  drawStage();
  if (page.video) doing(measureSoon)();
}
function forgetAnswer() {
  Object.assign(measuring, { answer: null, times: [], problem: '', key: '', took: 0 });
}
function forgetScene() {
  Object.assign(scene, { ruler: null, origin: null });
  forgetAnswer();
  for (const id of ['length', 'length-error', 'angle', 'fps', 'fps-error', 'fit-from', 'fit-to']) byId(id).value = '';
  if (page.tool) takeTool(null);
}

let plots = [];
function drawMeasured() {
  const { answer, problem } = measuring, { fit, ask = [], notes = [] } = answer || {}, curve = byId('fit-curve').value;
  byId('fps').placeholder = page.video.rate ? say(page.video.rate, 0) : '';
  byId('scale-now').textContent = answer?.unit === 'm' ? `${wordOf('length')} ${byId('length-unit').value} over ${say(rulerLength(), 1)} px, ± ${say(100 * answer.relative[0])} %` : 'no length yet: everything is in pixels';
  byId('axes-now').textContent = `origin: ${scene.origin ? `${scene.origin.map(v => say(v + 1)).join(', ')} px` : 'the first position'}; x points ${+byId('angle').value ? `${byId('angle').value}° upwards` : 'right'}, y ${+byId('angle').value ? '90° further' : 'up'}`;
  byId('measure-state').textContent = [problem, ...notes, answer?.summary].filter(Boolean).join(' ');
  const main = curve === 'parabola' ? (fit?.axis === 1 ? 'g' : 'a') : MAIN[curve], values = fit ? [...fit.values] : [];
  values.sort((a, b) => b.startsWith(main + ' =') - a.startsWith(main + ' ='));
  byId('fit-values').replaceChildren(...values.map(value => element('li', {}, value)));
  byId('fit-about').textContent = fit ? `${'xy'[fit.axis]} = ${fit.formula}, t from ${say(fit.t0, 3)} s, ${counted(fit.points, 'point')}, residuals ${fit.rms.toExponential(1).replace('-', '−')} ${answer.unit} (rms)` : '';
  byId('doubts').hidden = !ask.length;
  byId('doubt-list').replaceChildren(...ask.slice(0, 20).map(({ frame, from, to, reason }) => {
    const button = element('button', { type: 'button', class: 'wide' }, `Frame ${frame}${from < to ? ` (${from} to ${to})` : ''}: ${REASONS[reason]}`);
    button.addEventListener('click', doing(async () => { await stepTo(frame); byId('stage').scrollIntoView({ block: 'start' }); }));
    return element('li', {}, button);
  }));
  byId('measure-command').textContent = answer?.command || '';
  byId('measure-command').closest('details').hidden = !answer?.command;
  byId('measure-files').hidden = !answer;
  drawPlots();
}
function drawPlots() {
  const { answer } = measuring, holder = byId('plots');
  plots = [];
  if (!answer || answer.times.length < 2 || !holder.clientWidth) return holder.replaceChildren();
  const { times, motion, tracked, fit } = answer, span = [times[0], times.at(-1)], two = holder.clientWidth > 700, wide = Math.floor(holder.clientWidth), width = two ? Math.floor((wide - 20) / 2) : wide;
  const charts = motion.map((one, i) => ({ ...one, ink: `ink-${i % 2}`, dots: i < 2 ? times.map((t, k) => [t, tracked[i][k] ?? NaN]) : [], curve: fit?.axis === i ? fit.curve : [] }));
  // Residuals have a row of their own, below the positions.
  if (fit) charts.splice(2, 0, { width: wide, label: `${'xy'[fit.axis]} minus the fit (${answer.unit})`, ink: `ink-${fit.axis} residuals`, value: times.map(() => 0), dots: fit.data.map(([t, , rest]) => [t, rest]) });
  const made = charts.map(one => plot({ width, ...one, times, span }));
  holder.replaceChildren(...made);
  plots = made.filter(chart => chart.mark);
  plots.forEach(listen);
  markTime();
}
// A click on a chart goes to its frame; a drag selects the times of the fit.
function listen(made) {
  let from = null, far = false, finger = null;
  made.addEventListener('pointerdown', event => { if (from !== null && event.pointerId !== finger) return; finger = event.pointerId; from = made.timeAt(event); far = false; made.setPointerCapture(event.pointerId); made.startX = event.clientX; });
  made.addEventListener('pointermove', event => {
    if (from === null || event.pointerId !== finger) return;
    far ||= Math.abs(event.clientX - made.startX) > 6;
    if (far) made.choose(from, made.timeAt(event));
  });
  made.addEventListener('pointercancel', event => { if (event.pointerId === finger) { from = null; markTime(); } });
  made.addEventListener('pointerup', doing(async event => {
    if (from === null || event.pointerId !== finger) return;
    const [start, end] = [from, made.timeAt(event)].sort((a, b) => a - b), { times, frames } = measuring.answer;
    from = null;
    if (far) {
      [byId('fit-from').value, byId('fit-to').value] = [start, end].map(secondsOf);
      return changed();
    }
    const best = times.reduce((best, t, i) => Math.abs(t - end) < Math.abs(times[best] - end) ? i : best, 0);
    await stepTo(frames[best]);
  }));
}
// The time of the frame shown, and the times of the fit, on all charts.
function markTime() {
  if (!measuring.answer) return;
  const { frames, times } = measuring.answer, i = frames.findIndex(frame => frame >= page.frame), range = [wordOf('fit-from'), wordOf('fit-to')];
  const chosen = range.some(Boolean) && byId('fit-curve').value;
  for (const made of plots) {
    made.mark(i < 0 || page.frame < frames[0] ? null : times[i]);
    made.choose(chosen ? +range[0] || times[0] : null, +range[1] || times.at(-1));
  }
}
for (const id of ['length', 'length-error', 'length-unit', 'angle', 'fps', 'fps-error', 'fit-curve', 'fit-axis', 'fit-from', 'fit-to']) byId(id).addEventListener('input', changed);
byId('fit-all').addEventListener('click', () => { byId('fit-from').value = byId('fit-to').value = ''; changed(); });
byId('measuring').addEventListener('toggle', () => {
  layers.find(layer => layer.name === 'scale').holder.hidden = !byId('measuring').open;
  measuring.key = '';
  changed();
});
layers.find(layer => layer.name === 'scale').holder.hidden = true;
for (const button of byId('measure-files').children) button.addEventListener('click', doing(async () => {
  const { files } = await tracker.ask(measureMessage({ files: true })), { name, text } = files.find(file => file.name === button.value);
  const link = element('a', { href: URL.createObjectURL(new Blob([text], { type: 'text/plain' })), download: page.target ? `target-${page.target + 1}-${name}` : name });
  link.click();
  unsaved = false;
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}));

// Playing, starting, correcting, and the page's beginning.
let hello = { pick: false, targets: 1 }, only = false;
const icons = { play: '<svg viewBox="0 0 16 16"><path d="M4 2.5v11l9.5-5.5z"/></svg>', pause: '<svg viewBox="0 0 16 16"><path d="M3.5 2.5h3.2v11H3.5zM9.3 2.5h3.2v11H9.3z"/></svg>' };
function transport() {
  byId('scrub').max = Number.isFinite(page.ends) ? page.ends : Math.max(page.frame + 100, lastTracked());
  byId('scrub').value = page.frame;
  byId('scrub').setAttribute('aria-valuetext', `frame ${page.frame}`);
  byId('back').disabled = page.frame <= 1;
  byId('forth').disabled = page.frame >= page.ends;
  tellEnd();
  const label = page.playing ? 'Pause' : page.rows.length && page.frame >= lastTracked() ? 'Track' : 'Play';
  if (byId('play').getAttribute('aria-label') !== label || !byId('play').firstChild) {
    byId('play').replaceChildren(drawing(page.playing ? icons.pause : icons.play));
    byId('play').setAttribute('aria-label', label);
  }
}
// Whether a box in this frame corrects the track. A frame ahead of it is tracked first; those of a camera may be gone.
const correctable = () => !!rowOf(page.frame) || page.rows.length > 0 && page.frame > lastTracked() && !page.ended && page.video.live === undefined;
const settings = () => ['config', 'policy', 'seed'].map(id => byId(id).value);
// What the box in hand can be used for.
function actions() {
  const box = !!page.draft;
  byId('go').textContent = hello.pick ? 'Use this box' : correctable() ? `Correct frame ${page.frame}` : page.rows.length ? 'Start anew here' : 'Start tracking';
  byId('again').hidden = hello.pick || !correctable();
  byId('add').hidden = hello.pick || !page.targets.length || page.targets.length >= hello.targets;
  for (const id of ['go', 'again', 'add']) byId(id).disabled = !box || page.busy;
  const { setup } = active();
  byId('setup-now').textContent = setup && setup.some((value, i) => value !== settings()[i]) ? `The track goes on with ${[setup[0], setup[1], setup[2] && `seed ${setup[2]}`].filter(Boolean).join(', ')}; these settings hold from the next start.` : '';
  drawTargets();
}
function pause() {
  if (page.playing) { page.playing = false; transport(); command(); }
}
async function command() {
  if (!page.rows.length) return;
  try { byId('command').textContent = (await tracker.ask({ op: 'command', session: page.video.session })).command; } catch { byId('command').textContent = ''; }
}
// Messages that change the track go one after the other.
async function idle() {
  while (page.busy) await new Promise(done => setTimeout(done, 10));
}
// Tracks one frame, or as many as the pace says, and shows the last one; not where somebody has paused meanwhile, perhaps to draw.
async function trackOn(frames, asked) {
  if (page.busy) return;
  page.busy = true;
  try {
    // Targets that are behind catch up first.
    const behind = Math.max(0, ...page.targets.filter(({ ended }) => !ended).map(target => lastTracked() - lastTracked(target)));
    const video = page.video, answer = await tracker.ask({ op: 'step', session: video.session, frames: frames + behind });
    if (video !== page.video) return;
    answer.targets.forEach((shown, i) => takeIn(page.targets[i], shown));
    if (answer.missed !== undefined) tellMissed(answer);
    if (asked || page.playing) await show(lastTracked());
    else panels();
    if (answer.problem) throw new Error(answer.problem);
  } finally { page.busy = false; actions(); }
}
async function play() {
  if (page.playing || page.busy || !page.video) return;
  const video = page.video;
  page.playing = true;
  setDraft(null);
  transport();
  try {
    while (page.playing && video === page.video) {
      const began = performance.now(), pace = +byId('pace').value, end = page.rows.length ? lastTracked() : page.ends;
      if (page.rows.length && page.frame >= lastTracked()) {
        if (page.targets.every(({ ended }) => ended)) break;
        await trackOn(pace, false);
      } else if (page.frame < end) await show(page.frame + 1);
      else break;
      // Not faster than the video where every frame is shown; and the page stays answerable.
      const rest = pace === 1 ? Math.max(0, 1000 / (video.rate || 30) - (performance.now() - began)) : 0;
      await new Promise(done => setTimeout(done, rest));
    }
  } finally {
    page.playing = false;
    transport();
    command();
  }
}
async function stepTo(frame) {
  pause();
  setDraft(null);
  // One frame on at the end of the track: track it.
  if (page.rows.length && frame === lastTracked() + 1 && page.frame === lastTracked() && !page.ended) { await trackOn(1, true); command(); }
  else await show(frame);
}
async function start(target) {
  const { x, y, w, h } = page.draft, frame = page.frame, seed = byId('seed').value;
  if (byId('seed').validity.badInput || seed !== '' && !(Number.isSafeInteger(+seed) && +seed >= 0)) throw new Error(`The seed must be a whole number from 0 to ${Number.MAX_SAFE_INTEGER}.`);
  const message = { op: 'start', session: page.video.session, target, frame, box: [x, y, w, h], config: byId('config').value, policy: byId('policy').value || null, seed: seed === '' ? null : +seed };
  const setup = settings();
  page.busy = true;
  try {
    const answer = await tracker.ask(message);
    page.targets[target] = { ...newTarget(frame, answer.cells, answer.policy), setup };
    page.target = target;
    takeIn(page.targets[target], answer);
  } finally { page.busy = false; }
  setDraft(null);
  arrange();
  await show(frame);
  doing(play)();
}
async function correct() {
  const { draft, frame, video } = page, { x, y, w, h } = draft;
  if (lastTracked() < frame) {
    page.playing = true;
    transport();
    try {
      while (page.playing && video === page.video && lastTracked() < frame && !page.ended) await trackOn(Math.min(200, frame - lastTracked()), false);
    } finally { page.playing = false; transport(); }
    // Paused on the way, or another video.
    if (video !== page.video || lastTracked() < frame) return;
  }
  page.busy = true;
  try {
    takeIn(active(), await tracker.ask({ op: 'correct', session: page.video.session, target: page.target, frame, box: [x, y, w, h] }));
  } finally { page.busy = false; }
  setDraft(null);
  await show(frame);
  command();
}
async function picked() {
  const { x, y, w, h } = page.draft;
  const answer = await tracker.ask({ op: 'picked', session: page.video.session, frame: page.frame, box: [x, y, w, h], config: byId('config').value, policy: byId('policy').value || null });
  byId('line').textContent = answer.command;
  byId('picked').hidden = false;
  if (answer.ends) {
    byId('about').textContent = 'The command was printed, and the program has ended: you can close this page.';
    for (const control of document.querySelectorAll('button:not(#copy), input, select')) control.disabled = true;
  }
}
async function use(how) {
  pause();
  await idle();
  if (!page.draft) return;
  if (hello.pick) await picked();
  else if (how === 'add') await start(page.targets.length);
  else if (how === 'go' && correctable()) await correct();
  else await start(page.target);
}
// Enter in a field of the box is the main button.
byId('boxes').addEventListener('submit', doing(event => { event.preventDefault(); return use('go'); }));
for (const id of ['again', 'add']) byId(id).addEventListener('click', doing(() => use(id)));
byId('copy').addEventListener('click', doing(() => navigator.clipboard.writeText(byId('line').textContent)));
byId('play').addEventListener('click', doing(() => page.playing ? pause() : play()));
byId('back').addEventListener('click', doing(() => stepTo(page.frame - 1)));
byId('forth').addEventListener('click', doing(() => stepTo(page.frame + 1)));
byId('scrub').addEventListener('input', doing(() => { const to = +byId('scrub').value; pause(); return show(to); }));
document.addEventListener('keydown', event => {
  if (!page.video || event.ctrlKey || event.metaKey || event.altKey || event.target.matches('select, a, summary, input:not([type=range], [type=checkbox])')) return;
  const far = event.shiftKey ? 10 : 1, onButton = event.target.matches('button, [type=checkbox]');
  const to = { ',': page.frame - far, '.': page.frame + far, '<': page.frame - 10, '>': page.frame + 10, ';': page.frame - 10, ':': page.frame + 10 }[event.key];
  if (to !== undefined) doing(() => stepTo(to))();
  else if (event.key === ' ' && !onButton) doing(() => page.playing ? pause() : play())();
  else return;
  event.preventDefault();
});
byId('config').addEventListener('change', () => { byId('config-for').textContent = hello.configs.find(c => c.name === byId('config').value)?.for.replaceAll('`', '') || ''; });
for (const id of ['config', 'policy', 'seed']) byId(id).addEventListener('input', () => actions());
window.addEventListener('resize', () => { drawStage(); drawGraph(); drawPlots(); });
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', drawGraph);

doing(async () => {
  hello = await tracker.ask({ op: 'hello' });
  // By purpose; the name is that of the command line.
  for (const group of new Set(hello.configs.map(config => config.group))) {
    const some = hello.configs.filter(config => config.group === group);
    byId('config').append(element('optgroup', { label: group }, ...some.map(({ name, title }) => element('option', { value: name }, title === name ? name : `${title} (${name})`))));
  }
  byId('config').value = hello.config;
  byId('config').dispatchEvent(new Event('change'));
  byId('policy').append(element('option', { value: '' }, "the configuration's"), ...hello.policies.map(name => element('option', { value: name }, name)));
  byId('policy').value = hello.policy || '';
  byId('pick-camera').hidden = hello.pick;
  byId('seed').hidden = document.querySelector('[for=seed]').hidden = hello.pick;
  if (hello.pick) byId('about').textContent = 'Draw a box: the command line that tracks it is printed where foveate was started.';
  trail = [{ name: 'all', path: '' }];
  const root = hello.roots.length === 1 && hello.roots[0];
  only = root && root.kind !== 'folder';
  if (only) await open_(root).catch(async error => { only = false; await list(''); throw error; });
  else if (root) { trail = []; await enter(root); }
  else await list('');
})();

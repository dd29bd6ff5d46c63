// Choosing a video, and saving results.
const KINDS = { folder: 'folder', images: 'pictures', video: 'video', stream: 'stream' };
let trail = [];
async function list(path) {
  const { entries } = await tracker.ask({ op: 'list', path });
  byId('entries').replaceChildren(...entries.map(entry => {
    const button = element('button', { type: 'button' }, element('b', {}, entry.name), element('span', {}, KINDS[entry.kind]));
    button.addEventListener('click', doing(() => entry.kind === 'folder' ? enter(entry) : open_(entry)));
    return element('li', {}, button);
  }));
  if (!entries.length) byId('entries').append(element('li', { class: 'soft' }, 'There is no video here, and no folder with pictures.'));
  byId('crumbs').replaceChildren(...trail.map((step, i) => {
    const button = element('button', { type: 'button' }, step.name);
    button.addEventListener('click', doing(() => { trail = trail.slice(0, i + 1); return list(step.path); }));
    return button;
  }));
}
async function enter(entry) {
  trail.push({ name: entry.name, path: entry.path });
  await list(entry.path);
}
async function open_(entry) {
  if (unsaved && !confirm('The results are not saved. Open another video?')) return;
  pause();
  await idle();
  const close = () => page.video && tracker.ask({ op: 'close', session: page.video.session }).catch(() => {});
  // A camera can be open once.
  if (page.video?.live) await close();
  const opened = await tracker.ask({ op: 'open', path: entry.path }), name = entry.name.split(/[\\/]/).filter(Boolean).pop() || entry.name;
  if (page.video && !page.video.live) close();
  for (const picture of pictures.values()) picture.close?.();
  pictures.clear();
  shown = null;
  forgetScene();
  Object.assign(page, { video: { ...opened, name }, frame: 1, ends: opened.frames || Infinity, targets: [], target: 0, draft: null });
  layers.find(layer => layer.name === 'truth').holder.hidden = !opened.truth.some(Boolean);
  byId('title').textContent = name;
  byId('about').textContent = `${opened.width} × ${opened.height}, ${opened.frames ? `${opened.exact ? '' : 'about '}${counted(opened.frames, 'frame')}` : 'length unknown'}, ${opened.rate ? `${say(opened.rate, 0)} a second, ` : ''}${opened.reader}`;
  arrange();
  setDraft(null);
  forgetSaved();
  // What comes but once cannot be run once more for a report or a film, nor by a command.
  const { live } = opened, again = live === undefined;
  tellMissed({ missed: 0 });
  document.body.classList.toggle('live', !!live);
  for (const id of ['want-report', 'want-film']) byId(id).closest('label').hidden = !again;
  byId('want-text').textContent = again && !tracker.offer ? 'boxes.txt, track.csv' : 'boxes.txt, track.csv, track.jsonl';
  byId('command').closest('details').hidden = !again;
  await show(1);
  if (live) doing(play)();
}
// Which cards are there.
function arrange() {
  const open = !!page.video, tracked = page.rows.length > 0;
  for (const [id, there] of Object.entries({ picker: !open, stage: open, setup: open, fovea: tracked && !hello.pick, curve: tracked && !hello.pick, measure: tracked && !hello.pick, save: tracked && !hello.pick, legend: open && !hello.pick })) byId(id).hidden = !there;
  byId('choose').hidden = !open || only;
}
byId('choose').addEventListener('click', doing(async () => {
  pause();
  byId('picker').hidden = !byId('picker').hidden;
  if (!byId('picker').hidden) byId('entries').querySelector('button')?.focus();
}));

// A page with another tracker has its own way to the camera.
byId('pick-camera').addEventListener('click', doing(() => tracker.offer ? null : open_({ name: 'camera', path: CAMERA })));

let saving = 0, unsaved = false;
function forgetSaved() {
  saving++;
  unsaved = page.targets.some(({ rows }) => rows.length);
  byId('files').replaceChildren();
  byId('save-state').textContent = '';
  byId('save-go').disabled = false;
}
byId('save-go').addEventListener('click', doing(async () => {
  pause();
  await idle();
  forgetSaved();
  const mine = saving, session = page.video.session, state = byId('save-state');
  const again = page.video.live === undefined, total = page.targets.reduce((sum, { count }) => sum + count, 0);
  byId('save-go').disabled = true;
  try {
    await tracker.ask({ op: 'save', session, film: again && byId('want-film').checked, report: again && byId('want-report').checked });
    for (;;) {
      const { frames, files } = await tracker.ask({ op: 'saved', session });
      if (mine !== saving) return;
      if (files) {
        state.textContent = 'Ready to download:';
        unsaved = false;
        byId('files').replaceChildren(...files.map(name => element('li', {}, element('a', { href: tracker.link(session, name), download: name }, name))));
        return;
      }
      state.textContent = `Writing frame ${frames} of ${total} …`;
    }
  } finally { if (mine === saving) byId('save-go').disabled = false; }
}));
byId('save-picture').addEventListener('click', doing(async () => {
  const zoom = Math.max(1, Math.ceil(960 / page.video.width)), canvas = document.createElement('canvas');
  canvas.width = zoom * page.video.width;
  canvas.height = zoom * page.video.height;
  paint(canvas.getContext('2d'), canvas.width, canvas.height, false);
  const blob = await new Promise(done => canvas.toBlob(done, 'image/png'));
  const link = element('a', { href: URL.createObjectURL(blob), download: `${page.video.name.replace(/[^\w.-]+/g, '-')}-${page.frame}.png` });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}));
// Who leaves is asked whether to lose what is not saved; then the tracker forgets the video, unless the browser keeps the page.
window.addEventListener('beforeunload', event => { if (unsaved) event.preventDefault(); });
window.addEventListener('pagehide', event => { if (page.video && !event.persisted) tracker.leave?.(page.video.session); });

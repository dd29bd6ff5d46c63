// Tabs, and the ways to choose a video.
const tabs = [['tab-track', 'main'], ['tab-lesson', 'lesson']].map(([tab, panel]) => ({ tab: byId(tab), panel: byId(panel) }));
function turnTo(which, focus) {
  tabs.forEach(({ tab, panel }, i) => {
    tab.setAttribute('aria-selected', String(i === which));
    tab.tabIndex = i === which ? 0 : -1;
    panel.hidden = i !== which;
  });
  if (focus) tabs[which].tab.focus();
  complain(null);
  byId('choose').hidden = which !== 0 || !page.video;
  const heading = which ? ['Learn where to look', 'A particle filter learns, while you watch, which region of a digit is most informative.'] : page.video ? null : ['foveate', 'Follow an object through a video or before your camera. Nothing leaves this device.'];
  if (which) pause();
  else lessonPause();
  if (heading) [byId('title').textContent, byId('about').textContent] = heading;
  else describeVideo();
  if (which) doing(lessonShown)();
  else { drawStage(); if (page.video) drawGraph(); }
  history.replaceState(null, '', which ? '#lesson' : location.pathname + location.search);
}
tabs.forEach(({ tab }, i) => {
  tab.addEventListener('click', () => turnTo(i));
  tab.addEventListener('keydown', event => {
    if (event.key !== 'ArrowLeft' && event.key !== 'ArrowRight') return;
    turnTo(1 - i, true);
    event.preventDefault();
    event.stopPropagation();
  });
});

let described = null;
function describeVideo() {
  if (!described) return;
  [byId('title').textContent, byId('about').textContent] = described;
}
async function choose(entry) {
  await open_(tracker.offer(entry));
  described = [byId('title').textContent, byId('about').textContent];
  byId('screen').focus({ preventScroll: true });
}
const collator = new Intl.Collator('en', { numeric: true });
// Files that were dropped or picked: a video, or pictures with their true boxes perhaps.
async function take(files) {
  const place = file => file.webkitRelativePath || file.name, kind = name => name.split('.').pop().toLowerCase();
  const shown = files.filter(file => !file.name.startsWith('.'));
  const pictures = shown.filter(file => ['jpg', 'jpeg', 'png'].includes(kind(file.name))).sort((a, b) => collator.compare(place(a), place(b)));
  const videos = shown.filter(file => /^video\//.test(file.type) || ['mp4', 'm4v', 'mov', 'webm', 'mkv', 'avi', 'ogv'].includes(kind(file.name)));
  if (videos.length) return choose({ name: videos[0].name, files: videos.slice(0, 1) });
  if (!pictures.length) throw new Error('There is no video in it, and no JPEG or PNG pictures.');
  const folder = place(pictures[0]).split('/').slice(0, -1).filter(part => !/^img1?$/.test(part)).pop();
  return choose({ name: folder || pictures[0].name, files: pictures, truth: shown.find(file => file.name === 'groundtruth_rect.txt') });
}
// Files of folders that were dropped.
async function dropped(items) {
  const entries = items.map(item => item.webkitGetAsEntry?.()).filter(Boolean);
  const walk = async entry => {
    if (entry.isFile) {
      const file = await new Promise((yes, no) => entry.file(yes, no));
      Object.defineProperty(file, 'webkitRelativePath', { value: entry.fullPath.slice(1) });
      return [file];
    }
    const reader = entry.createReader(), inside = [];
    for (;;) {
      const some = await new Promise((yes, no) => reader.readEntries(yes, no));
      if (!some.length) break;
      inside.push(...some);
    }
    return (await Promise.all(inside.map(walk))).flat();
  };
  return (await Promise.all(entries.map(walk))).flat();
}
for (const [button, input] of [['pick-file', 'file'], ['pick-folder', 'folder']]) {
  byId(button).addEventListener('click', () => byId(input).click());
  byId(input).addEventListener('change', doing(async () => {
    const files = [...byId(input).files];
    byId(input).value = '';
    if (files.length) await take(files);
  }));
}
byId('pick-camera').addEventListener('click', doing(() => choose({ name: 'camera', camera: true })));
// Anywhere on the page: a file that misses the frame must not take the page's place.
for (const name of ['dragenter', 'dragover', 'dragleave', 'drop']) document.addEventListener(name, event => {
  if (![...event.dataTransfer?.types || []].includes('Files')) return;
  event.preventDefault();
  byId('drop').classList.toggle('over', name === 'dragenter' || name === 'dragover');
});
document.addEventListener('drop', doing(async event => {
  if (!event.dataTransfer?.items.length) return;
  const files = dropped([...event.dataTransfer.items]);
  if (byId('main').hidden) turnTo(0);
  await take(await files);
}));
if (location.protocol === 'file:') complain(new Error('Browsers do not start this page from a file. In its folder run: python3 -m http.server, then open http://localhost:8000/'));
if (location.hash === '#lesson') turnTo(1);

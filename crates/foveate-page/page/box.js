// The box drawn by hand: with the mouse or a finger, by keys, or in figures.
const fields = ['x', 'y', 'w', 'h'];
function setDraft(draft) {
  page.draft = draft;
  for (const name of fields) byId('box-' + name).value = draft ? draft[name] + (name === 'x' || name === 'y' ? 1 : 0) : '';
  drawStage();
  actions();
}
const clamp = (value, low, high) => Math.min(Math.max(value, low), Math.max(low, high));
// Whole pixels, in the picture.
function fitted({ x, y, w, h }) {
  const { width, height } = page.video;
  w = clamp(Math.round(w), 2, width); h = clamp(Math.round(h), 2, height);
  return { x: clamp(Math.round(x), 0, width - w), y: clamp(Math.round(y), 0, height - h), w, h };
}
for (const name of fields) byId('box-' + name).addEventListener('input', () => {
  const [x, y, w, h] = fields.map(n => byId('box-' + n).value === '' ? NaN : +byId('box-' + n).value);
  pause();
  page.draft = [x, y, w, h].every(Number.isFinite) && w > 0 && h > 0 ? { x: x - 1, y: y - 1, w, h } : null;
  drawStage();
  actions();
});

let drag = null;
// A second finger moves nothing.
const isDrag = event => drag?.id === event.pointerId;
const screen_ = byId('screen');
function pointed(event) {
  const area = screen_.getBoundingClientRect();
  const inside = (value, size) => clamp(value, 0, size);
  return [inside((event.clientX - area.left) / area.width * page.video.width, page.video.width), inside((event.clientY - area.top) / area.height * page.video.height, page.video.height)];
}
screen_.addEventListener('pointerdown', event => {
  if (!page.video || event.button !== 0 || drag && !isDrag(event)) return;
  pause();
  screen_.focus({ preventScroll: true });
  screen_.setPointerCapture(event.pointerId);
  drag = { id: event.pointerId, from: pointed(event), client: [event.clientX, event.clientY], far: false, tool: page.tool };
  event.preventDefault();
  if (drag.tool) { drag.tool.press(pixelOf(drag.from)); changed(); }
});
screen_.addEventListener('pointermove', event => {
  if (!isDrag(event)) return;
  if (drag.tool) { drag.tool.move(pixelOf(pointed(event))); return changed(); }
  drag.far ||= Math.hypot(event.clientX - drag.client[0], event.clientY - drag.client[1]) > 5;
  if (!drag.far) return;
  const [[x0, y0], [x1, y1]] = [drag.from, pointed(event)];
  setDraft(fitted({ x: Math.min(x0, x1), y: Math.min(y0, y1), w: Math.abs(x1 - x0), h: Math.abs(y1 - y0) }));
});
screen_.addEventListener('pointerup', doing(async event => {
  if (!isDrag(event)) return;
  const was = drag;
  drag = null;
  if (was.tool) { was.tool.release(); return changed(); }
  if (!was.far) await propose(was.from);
}));
screen_.addEventListener('pointercancel', event => {
  if (!isDrag(event)) return;
  const { tool } = drag;
  drag = null;
  if (tool) { tool.release(); changed(); }
});
// The pixel at a place of the frame, whose first pixel has its centre at (0, 0).
const pixelOf = place => place.map(v => quarter(v - .5));

const SOURCES = { motion: 'what moves there', saliency: 'what stands out there', size: 'a plain box: nothing moves or stands out there' };
async function propose(at) {
  pause();
  const frame = page.frame, answer = await tracker.ask({ op: 'propose', session: page.video.session, frame, at });
  if (frame !== page.frame) return;
  const [x, y, w, h] = answer.box;
  setDraft({ x, y, w, h });
  byId('figures').textContent = `Proposed: ${SOURCES[answer.from]}. Arrows move it.`;
}
byId('propose').addEventListener('click', doing(() => propose(null)));

screen_.addEventListener('keydown', event => {
  if (!page.video || event.ctrlKey || event.metaKey) return;
  const { width, height } = page.video, step = event.altKey ? 1 : Math.max(1, Math.round(Math.max(width, height) / 100));
  const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
  if (page.tool) {
    const far = event.shiftKey ? 10 : event.altKey ? .25 : 1;
    if (way) page.tool.nudge(far * way[0], far * way[1]);
    else if (event.key === 'Enter') page.tool.other();
    else if (event.key === 'Escape') takeTool(null);
    else return;
    changed();
  } else if (way) {
    pause();
    const side = Math.round(Math.min(width, height) / 5), row = rowOf(page.frame);
    const begin = row ? { x: row.box[0], y: row.box[1], w: row.box[2], h: row.box[3] } : { x: (width - side) / 2, y: (height - side) / 2, w: side, h: side };
    const box = page.draft || fitted(begin), [dx, dy] = [way[0] * step, way[1] * step];
    if (!page.draft) setDraft(box);
    else setDraft(fitted(event.shiftKey ? { ...box, w: box.w + dx, h: box.h + dy } : { ...box, x: box.x + dx, y: box.y + dy }));
  } else if (event.key === 'Enter') { if (!byId('go').disabled) byId('go').click(); }
  else if (event.key === 'Escape') setDraft(null);
  else return;
  event.preventDefault();
  event.stopPropagation();
});

// The scale and the axes of a measurement, set on the frame; in pixels from 0, at the pixels' centres, to a quarter.
const scene = { ruler: null, origin: null };
const REACH = 18, SCALE_INK = '#ffd84d', AXES_INK = '#ff8fe0';
const quarter = v => Math.round(4 * v) / 4, zoomOf = () => screen_.clientWidth / page.video.width;
const isNear = (a, b) => !!a && !!b && Math.hypot(a[0] - b[0], a[1] - b[1]) * zoomOf() < REACH;
const turned = () => (+byId('angle').value || 0) * Math.PI / 180;
const originNow = () => scene.origin || measuring.answer?.origin || null;
const rulerLength = () => scene.ruler && Math.hypot(scene.ruler[0][0] - scene.ruler[1][0], scene.ruler[0][1] - scene.ruler[1][1]);
// The tip of the x axis, by which it is turned.
function tipOf(origin, turn = turned()) {
  const long = Math.min(page.video.width, page.video.height) / 4;
  return origin && [origin[0] + long * Math.cos(turn), origin[1] - long * Math.sin(turn)];
}
// A tool has `press`, `move` and `release` for the pointer, `nudge` for keys, and `held`, the point that it moves now. What is pressed
// again moves at a quarter of the speed.
const tools = {
  scale: {
    hint: 'Drag along a known length on the frame, then type its length. Drag an end again to place it finely. Keys: arrows move an end, Enter takes the other one.',
    end: 1, held: null,
    press(at) {
      const found = scene.ruler ? [0, 1].find(i => isNear(scene.ruler[i], at)) : undefined;
      this.grip = found === undefined ? null : { at, was: scene.ruler[found] };
      this.end = found ?? 1;
      // A click draws none: then the one before stays.
      this.before = scene.ruler;
      if (found === undefined) scene.ruler = [at, at];
      this.held = scene.ruler[this.end];
    },
    move(at) {
      scene.ruler[this.end] = this.held = finely(this.grip, at);
    },
    release() {
      this.held = null;
      if (rulerLength() * zoomOf() < 4) scene.ruler = this.grip ? null : this.before;
      else if (!byId('length').value) byId('length').focus({ preventScroll: true });
    },
    nudge(dx, dy) {
      const { width, height } = page.video;
      scene.ruler ||= [[Math.round(width / 3), Math.round(height / 2)], [Math.round(2 * width / 3), Math.round(height / 2)]];
      scene.ruler[this.end] = inFrame(scene.ruler[this.end], dx, dy);
    },
    other() { this.end = 1 - this.end; },
  },
  axes: {
    hint: 'Press where the origin is. Drag it again to place it finely; drag the tip of the x axis to turn it. Arrow keys move the origin.',
    held: null,
    press(at) {
      const origin = originNow();
      this.turning = isNear(tipOf(origin), at);
      if (this.turning) return;
      this.grip = isNear(scene.origin, at) ? { at, was: scene.origin } : null;
      if (!this.grip) scene.origin = at;
      this.held = scene.origin;
    },
    move(at) {
      if (this.turning) {
        const [x, y] = originNow();
        byId('angle').value = Math.round(10 * Math.atan2(y - at[1], at[0] - x) * 180 / Math.PI) / 10;
      } else scene.origin = this.held = finely(this.grip, at);
    },
    release() { this.held = null; },
    nudge(dx, dy) { scene.origin = inFrame((originNow() || [page.video.width / 2, page.video.height / 2]).map(quarter), dx, dy); },
    other() {},
  },
};
const inFrame = ([x, y], dx, dy) => [clamp(x + dx, 0, page.video.width - 1), clamp(y + dy, 0, page.video.height - 1)];
const finely = (grip, at) => grip ? inFrame(grip.was, quarter((at[0] - grip.at[0]) / 4), quarter((at[1] - grip.at[1]) / 4)) : at;

function takeTool(name) {
  pause();
  setDraft(null);
  page.tool = tools[name] || null;
  byId('tool').hidden = !page.tool;
  byId('tool-hint').textContent = page.tool?.hint || '';
  byId('tool-scale').hidden = name !== 'scale';
  byId('tool-axes').hidden = name !== 'axes';
  if (page.tool) { byId('stage').scrollIntoView({ block: 'start' }); screen_.focus({ preventScroll: true }); }
  drawStage();
}
// The scale and the axes on the frame; `at` says where a place is drawn.
function paintScene(c, at) {
  const { cased, cross } = penOf(c, .7), origin = originNow(), arrow = (from, to) => {
    const turn = Math.atan2(to[1] - from[1], to[0] - from[0]), wing = by => [to[0] - 9 * Math.cos(turn + by), to[1] - 9 * Math.sin(turn + by)];
    cased(() => { c.moveTo(...from); c.lineTo(...to); c.moveTo(...wing(.5)); c.lineTo(...to); c.lineTo(...wing(-.5)); }, AXES_INK, 1.8);
  };
  const text = (words, x, y, ink) => {
    c.font = '600 13px system-ui, sans-serif'; c.lineWidth = 3; c.strokeStyle = 'rgb(8 9 11 / .8)'; c.fillStyle = ink;
    c.strokeText(words, x, y); c.fillText(words, x, y);
  };
  if (origin) {
    const from = at(...origin);
    for (const [name, turn] of [['x', turned()], ['y', turned() + Math.PI / 2]]) {
      const to = at(...tipOf(origin, turn));
      arrow(from, to);
      text(name, to[0] + 6, to[1] - 6, AXES_INK);
    }
    cross(...from, 4, '#ffffff');
  }
  if (scene.ruler) {
    const [a, b] = scene.ruler.map(end => at(...end)), turn = Math.atan2(b[1] - a[1], b[0] - a[0]) + Math.PI / 2, [dx, dy] = [7 * Math.cos(turn), 7 * Math.sin(turn)];
    cased(() => { c.moveTo(...a); c.lineTo(...b); for (const [x, y] of [a, b]) { c.moveTo(x - dx, y - dy); c.lineTo(x + dx, y + dy); } }, SCALE_INK, 1.8);
    if (byId('length').value) text(`${byId('length').value} ${byId('length-unit').value}`, (a[0] + b[0]) / 2 + 10, (a[1] + b[1]) / 2 - 8, SCALE_INK);
  }
}
// What is around the point that is being placed, larger, in the corner away from it.
function paintLoupe(c, width, height, at) {
  const [px, py] = page.tool.held, side = Math.min(150, width / 2.4), zoom = Math.max(4, 2 * zoomOf()), reach = side / zoom, ratio = shown.picture.width / page.video.width;
  const [left, top] = [at(px, py)[0] < width / 2 ? width - side - 8 : 8, at(px, py)[1] < height / 2 ? height - side - 8 : 8];
  c.fillStyle = '#08090b';
  c.fillRect(left, top, side, side);
  c.imageSmoothingEnabled = false;
  c.drawImage(shown.picture, (px + .5 - reach / 2) * ratio, (py + .5 - reach / 2) * ratio, reach * ratio, reach * ratio, left, top, side, side);
  c.strokeStyle = '#ffffff'; c.lineWidth = 2; c.strokeRect(left, top, side, side);
  penOf(c).cross(left + side / 2, top + side / 2, 10, SCALE_INK, 1.2);
}
for (const name of ['scale', 'axes']) byId(`${name}-set`).addEventListener('click', doing(() => takeTool(name)));
byId('tool-done').addEventListener('click', () => { takeTool(null); byId('measure').scrollIntoView({ block: 'start' }); });
byId('origin-first').addEventListener('click', () => { scene.origin = null; changed(); });

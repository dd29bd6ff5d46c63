// The state of the page. Frames count from 1, pixels from 0.
const tracker = remoteTracker();
const page = {
  video: null,     // the answer to `open`, with its path and name
  frame: 1,        // the frame shown
  ends: Infinity,  // the last frame, as far as it is known
  targets: [],     // what is followed: see `newTarget`
  target: 0,       // which of them the panels are about
  draft: null,     // the box drawn by hand: x, y, w, h
  tool: null,      // what the pointer sets on the frame in place of a box: see ruler.js
  version: 0,      // counts the changes of the tracks
  playing: false,
  busy: false,     // a message is on its way that changes the track
  get rows() { return active().rows; },
  get first() { return active().first; },
  get cells() { return active().cells; },
  get policy() { return active().policy; },
  get ended() { return active().ended; },
  get details() { return active().details; },
};
const newTarget = (first, cells, policy) => ({
  first, cells, policy,   // the frame of the first row; the retina's cells; the policy's name
  rows: [],               // a row for each frame tracked; of a camera or a stream the last ones
  count: 0,               // frames tracked so far
  details: new Map(),     // by frame
  eye: eyeOf(cells),
  ended: false,
});
const nobody = { first: 0, cells: [], policy: '', rows: [], count: 0, details: new Map(), eye: null, ended: false };
const active = () => page.targets[page.target] || nobody;
const pictures = new Map();
// Of a camera or a stream rows are kept for the curve of P(lost), and details for steps back; results are the tracker's.
const KEPT_DETAILS = 600, KEPT_PICTURES = 24, KEPT_ROWS = 3000, KEPT_LIVE = 64;
function keep(map, key, value, most) {
  map.delete(key);
  map.set(key, value);
  for (const old of map.keys()) {
    if (map.size <= most) break;
    map.get(old)?.close?.();
    map.delete(old);
  }
}
const rowOf = (frame, target = active()) => target.rows[frame - target.first];
const lastRow = () => page.rows[page.rows.length - 1];
const lastTracked = (target = active()) => target.rows.length ? target.first + target.rows.length - 1 : 0;

// The picture of a frame; those shown last are kept.
async function pictureOf(frame) {
  const kept = pictures.get(frame);
  if (kept) return kept;
  const video = page.video, made = await tracker.picture(video.session, frame);
  if (video === page.video) keep(pictures, frame, made, KEPT_PICTURES);
  return made;
}
async function detailOf(frame) {
  if (!rowOf(frame) || rowOf(frame).given) return null;
  const { details } = page;
  if (!details.has(frame)) {
    const { detail } = await tracker.ask({ op: 'detail', session: page.video.session, target: page.target, frame });
    keep(details, frame, detail, page.video?.live ? KEPT_LIVE : KEPT_DETAILS);
  }
  return details.get(frame);
}
// Takes in rows of a target that were tracked, in the place of what was there from their frame on.
function takeIn(target, { rows, detail = null, surface = null, ended }) {
  const { live } = page.video;
  page.version++;
  target.ended = ended;
  if (rows.length) {
    target.count -= Math.max(0, lastTracked(target) - rows[0].frame + 1);
    target.rows.length = rows[0].frame - target.first;
    target.rows.push(...rows);
    target.count += rows.length;
    for (const frame of target.details.keys()) if (frame >= rows[0].frame) target.details.delete(frame);
    if (detail) keep(target.details, detail.frame, { ...detail, surface }, live ? KEPT_LIVE : KEPT_DETAILS);
    if (live && target.rows.length > 1.2 * KEPT_ROWS) {
      const more = target.rows.length - KEPT_ROWS;
      target.rows.splice(0, more);
      target.first += more;
    }
    if (lastTracked(target) > page.ends) page.ends = lastTracked(target);
  }
  if (ended) {
    page.ends = lastTracked(target);
    page.video.over = true;
  }
  forgetSaved();
}

// What the page knows. Frames count from 1, pixels from 0.
const tracker = remoteTracker();
const page = {
  video: null,     // the answer to `open`, with its path and name
  frame: 1,        // the frame shown
  ends: Infinity,  // the last frame, as far as it is known
  rows: [],        // a row for each frame tracked, the first one of frame `first`
  first: 0,
  cells: [],       // of the retina
  policy: '',
  ended: false,
  draft: null,     // the box drawn by hand: x, y, w, h
  playing: false,
  busy: false,     // a message is on its way that changes the track
};
const details = new Map(), pictures = new Map();
const KEPT_DETAILS = 600, KEPT_PICTURES = 24;
function keep(map, key, value, most) {
  map.delete(key);
  map.set(key, value);
  for (const old of map.keys()) {
    if (map.size <= most) break;
    map.get(old)?.close?.();
    map.delete(old);
  }
}
const rowOf = frame => page.rows[frame - page.first];
const lastRow = () => page.rows[page.rows.length - 1];
const lastTracked = () => page.rows.length ? page.first + page.rows.length - 1 : 0;

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
  if (!details.has(frame)) {
    const { detail } = await tracker.ask({ op: 'detail', session: page.video.session, frame });
    keep(details, frame, detail, KEPT_DETAILS);
  }
  return details.get(frame);
}
// Takes in rows that were tracked, in the place of what was there from their frame on.
function takeIn({ rows, detail = null, surface = null, ended }) {
  page.ended = ended;
  if (rows.length) {
    page.rows.length = rows[0].frame - page.first;
    page.rows.push(...rows);
    for (const frame of [...details.keys()]) if (frame >= rows[0].frame) details.delete(frame);
    if (detail) keep(details, detail.frame, { ...detail, surface }, KEPT_DETAILS);
    if (lastTracked() > page.ends) page.ends = lastTracked();
  }
  if (ended) page.ends = lastTracked();
  forgetSaved();
}

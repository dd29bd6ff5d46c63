// Follows a target by the WebAssembly in node: node follow.mjs FOLDER-OF-THE-PAGE CONFIG x,y,w,h FRAMES FILE...
// Prints one line of JSON: boxes, seconds in the tracker alone (`tracking`) and with reading and decoding (`whole`), bytes of memory.
import { readFileSync, openSync, readSync, statSync } from 'node:fs';
import { basename } from 'node:path';
const [page, config, init, frames, ...paths] = process.argv.slice(2);
const { load } = await import('data:text/javascript,' + encodeURIComponent(readFileSync(page + '/binding.js', 'utf8')));
const files = paths.map((path, id) => ({ id, name: basename(path), size: statSync(path).size }));
const open = paths.map(path => openSync(path));
const read = (id, at, length) => {
  const bytes = new Uint8Array(length);
  return bytes.subarray(0, readSync(open[id], bytes, 0, length, at));
};
const tracker = await load(readFileSync(page + '/foveate.wasm'), read);
const { session, ...about } = tracker.ask({ op: 'open', name: 'video', files, truth: null });
// Read, decoded and tracked; then pushed, so that only tracking is timed. Of each frame the best of five rounds: other work on the
// machine disturbs less.
const most = Math.min(+frames, about.frames), pixels = [];
let began = performance.now();
for (let k = 1; k <= most; k++) pixels.push(tracker.picture(session, k));
const decoding = (performance.now() - began) / 1e3;
const box = init.split(',').map(Number);
const follow = id => {
  tracker.ask({ op: 'start', session: id, frame: 1, box, config, policy: null, seed: null });
};
follow(session);
const all = [], wholes = new Array(most).fill(Infinity);
wholes[0] = 0;
for (let round = 0; round < 5; round++) {
  if (round) follow(session);
  all.length = 0;
  for (let k = 1; k < most; k++) {
    const now = performance.now();
    all.push(...tracker.ask({ op: 'step', session, frames: 1 }).targets[0].rows);
    wholes[k] = Math.min(wholes[k], (performance.now() - now) / 1e3);
  }
}
const whole = wholes.reduce((sum, seconds) => sum + seconds, 0);
const live = tracker.ask({ op: 'live', name: 'pushed', width: about.width, height: about.height, rate: 30 }).session;
const best = new Array(most).fill(Infinity);
let pushed = [];
best[0] = 0;
for (let round = 0; round < 5; round++) {
  const id = round ? tracker.ask({ op: 'live', name: 'pushed', width: about.width, height: about.height, rate: 30 }).session : live;
  tracker.push(id, pixels[0], 0, 0);
  follow(id);
  pushed = [];
  for (let k = 1; k < most; k++) {
    tracker.push(id, pixels[k], k / 30, 0);
    const now = performance.now();
    pushed.push(...tracker.ask({ op: 'step', session: id, frames: 1 }).targets[0].rows);
    best[k] = Math.min(best[k], (performance.now() - now) / 1e3);
  }
  tracker.ask({ op: 'close', session: id });
}
const boxes = [box, ...all.slice(0, most - 1).map(row => row.box)];
console.log(JSON.stringify({ boxes, frames: most, tracking: best.reduce((sum, seconds) => sum + seconds, 0), whole, decoding, memory: tracker.size(), pushed: pushed.map(row => row.box) }));

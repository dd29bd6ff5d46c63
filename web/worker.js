// The tracker in a thread of its own: messages in, answers out, one after the other.
import { load } from './binding.js';
import { decoderOf } from './codecs.js';

const files = new Map(), decoders = new Map();
const readFile = (id, at, length) => new Uint8Array(new FileReaderSync().readAsArrayBuffer(files.get(id).slice(at, at + length)));
const tracker = (async () => load(await (await fetch('foveate.wasm')).arrayBuffer(), readFile))();
// How long frames are tracked in for one message, milliseconds: so long does a pause take.
const LONGEST_STEP = 100;

// Tracks frames; each is decoded by the browser where it can, else by the tracker itself: none is left out.
async function step(t, { session, frames }) {
  let all = null;
  const held = decoders.get(session);
  for (const began = performance.now(); frames > 0 && (!all || performance.now() - began < LONGEST_STEP); frames--) {
    // Behind its last frame the tracker finds the end by itself.
    const { next } = held?.decoder ? t.ask({ op: 'next', session }) : {};
    if (next && next !== held.given && next <= held.last) {
      try {
        const { width, height, nv12, bytes } = await held.decoder.frame(next);
        if (!t.decoded(session, next, width, height, nv12, bytes)) throw new Error('the frame has another size');
        held.given = next;
      } catch (error) {
        held.decoder.close();
        Object.assign(held, { decoder: null, why: error.message });
      }
    }
    let got;
    // What was tracked before a failure is kept.
    try { got = t.ask({ op: 'step', session, frames: 1 }); } catch (error) {
      if (!all || error instanceof WebAssembly.RuntimeError) throw error;
      return { targets: all, problem: error.message };
    }
    const { targets, problem } = got;
    all = all ? all.map((before, i) => ({ ...targets[i], rows: [...before.rows, ...targets[i].rows], detail: targets[i].detail ?? before.detail })) : targets;
    if (problem) return { targets: all, problem };
    if (targets.every(target => target.ended)) break;
  }
  return { targets: all };
}

const does = {
  ask: async (t, { message, give = [] }) => {
    for (const [id, file] of give) files.set(id, file);
    if (message.op === 'step') return [await step(t, message)];
    if (message.op === 'close') {
      decoders.get(message.session)?.decoder?.close();
      decoders.delete(message.session);
    }
    return [t.ask(message)];
  },
  // Lets the browser decode a file, where it can.
  async decode(t, { session, file }) {
    try {
      const list = t.ask({ op: 'coded', session });
      const decoder = await decoderOf(list, (at, length) => readFile(file, at, length));
      if (decoder) decoders.set(session, { decoder, counts: decoder.counts, last: list.frames.reduce((most, frame) => Math.max(most, frame), 0) });
      return [!!decoder];
    } catch { return [false]; }
  },
  // How many frames the browser decoded, and why it does no longer.
  decoded: (t, { session }) => [{ frames: decoders.get(session)?.counts.decoded ?? 0, why: decoders.get(session)?.why ?? null }],
  forget: (t, { ids }) => { ids.forEach(id => files.delete(id)); return [null]; },
  async picture(t, { session, frame, width, height }) {
    const pixels = t.picture(session, frame);
    if (!pixels) throw new Error('the video has no such frame');
    const bitmap = await createImageBitmap(new ImageData(new Uint8ClampedArray(pixels.buffer), width, height));
    return [bitmap, bitmap];
  },
  push(t, { session, pixels, time, missed }) {
    const frame = t.push(session, new Uint8Array(pixels), time, missed);
    if (frame < 0) throw new Error('a frame has another size than the first one; open the video again');
    return [frame];
  },
  // A saved file, piece by piece: the tracker never has it whole.
  file(t, { session, name }) {
    const pieces = [];
    for (let piece; (piece = t.file(session, name, pieces.length)); ) pieces.push(piece);
    return [pieces.length ? new Blob(pieces, { type: 'application/octet-stream' }) : null];
  },
  size: t => [t.size()],
};
let broken = null, turn = Promise.resolve();
onmessage = ({ data }) => {
  turn = turn.then(async () => {
    try {
      if (broken) throw new Error(broken);
      const [value, ...transfer] = await does[data.does](await tracker, data);
      postMessage({ id: data.id, value }, transfer);
    } catch (error) {
      // After a trap the memory is in no state to go on with.
      if (error instanceof WebAssembly.RuntimeError) broken = `The tracker broke (${error.message}); load the page again.`;
      postMessage({ id: data.id, error: broken || error.message });
    }
  });
};

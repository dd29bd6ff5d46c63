// The tracker in a thread of its own: messages in, answers out, one after the other.
import { load } from './binding.js';

const files = new Map();
const readFile = (id, at, length) => new Uint8Array(new FileReaderSync().readAsArrayBuffer(files.get(id).slice(at, at + length)));
const tracker = (async () => load(await (await fetch('foveate.wasm')).arrayBuffer(), readFile))();

const does = {
  ask: (t, { message, give = [] }) => {
    for (const [id, file] of give) files.set(id, file);
    return [t.ask(message)];
  },
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
  file(t, { session, name }) {
    const bytes = t.file(session, name);
    return [bytes && bytes.buffer, ...(bytes ? [bytes.buffer] : [])];
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

// The tracker's WebAssembly behind a few functions. Bytes go through two buffers in its memory: see exports.rs.
// `source` is the file's bytes or a compiled module; `readFile(id, at, length)` gives bytes of a file of the page, or throws.
export async function load(source, readFile) {
  let wasm = null;
  const memory = (at, length) => new Uint8Array(wasm.memory.buffer, at, length);
  const page = {
    read_file(id, at, to, length) {
      try {
        const read = readFile(id, at, length);
        memory(to, read.length).set(read);
        return read.length;
      } catch { return -1; }
    },
  };
  const module = source instanceof WebAssembly.Module ? source : await WebAssembly.compile(source);
  wasm = (await WebAssembly.instantiate(module, { page })).exports;
  const put = data => memory(wasm.input(data.length), data.length).set(data);
  const taken = length => length < 0 ? null : memory(wasm.output(), length).slice();
  const encoder = new TextEncoder(), decoder = new TextDecoder();
  const answer = length => JSON.parse(decoder.decode(memory(wasm.output(), length)));
  return {
    // The answer to a call of the package, with the bytes of a picture or a state.
    call(message, bytes) {
      const text = encoder.encode(JSON.stringify(message)), at = wasm.input(text.length + bytes.length);
      memory(at, text.length).set(text);
      memory(at + text.length, bytes.length).set(bytes);
      return answer(wasm.call(text.length));
    },
    // The answer to a message; failures are thrown.
    ask(message) {
      put(encoder.encode(JSON.stringify(message)));
      const answered = answer(wasm.ask());
      if (answered.error) throw new Error(answered.error);
      return answered;
    },
    // Red, green, blue, alpha of a frame (from 1), or null.
    picture: (session, frame) => taken(wasm.picture(session, frame)),
    // Takes a frame of a camera; its number from 1, or −1.
    push(session, pixels, time, missed) {
      put(pixels);
      return wasm.push(session, time, missed);
    },
    // Takes the planes of a frame (from 1) that was decoded elsewhere: I420, or NV12. Whether they fit.
    decoded(session, frame, width, height, nv12, bytes) {
      put(bytes);
      return wasm.decoded(session, frame, width, height, nv12 ? 1 : 0) === 1;
    },
    // A piece of a saved file, from 0; null after the last one.
    file(session, name, piece) {
      put(encoder.encode(name));
      return taken(wasm.file(session, piece));
    },
    // Bytes of memory.
    size: () => wasm.memory.buffer.byteLength,
  };
}

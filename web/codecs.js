// H.264 in MP4 decoded by the browser (WebCodecs), ahead of the tracker. The list of samples comes from the tracker's own reader of
// MP4; each frame has its number in the place of its time, so that none is lost or shown twice unnoticed.
const AHEAD = 4;       // frames that are decoded and wait
const IN_FLIGHT = 16;  // samples given to the decoder that have not come back: more than any reorders

// `list` is the tracker's answer to `coded`, `read(at, length)` gives bytes of the file. `null` where the browser has no such decoder.
export async function decoderOf(list, read) {
  if (typeof VideoDecoder === 'undefined' || !list.codec) return null;
  const config = { codec: list.codec, description: new Uint8Array(list.description), optimizeForLatency: false };
  if (!(await VideoDecoder.isConfigSupported(config).catch(() => ({}))).supported) return null;
  const { offsets, sizes, frames, keys } = list, sampleOf = new Map(frames.map((frame, sample) => [frame, sample]));
  let decoder = null, next = 0, ready = [], failed = null, wake = null, flushing = false;
  const notify = () => { wake?.(); wake = null; };
  function stop() {
    ready.forEach(frame => frame.close());
    ready = [];
    if (decoder && decoder.state !== 'closed') decoder.close();
    decoder = null;
  }
  // Begins at the last key frame from which every frame from this one on can be had.
  function seek(frame) {
    stop();
    for (next = sampleOf.get(frame); next > 0 && !keys[next]; next--);
    const mine = decoder = new VideoDecoder({
      output: picture => { if (mine === decoder) ready.push(picture); else picture.close(); notify(); },
      error: error => { if (mine === decoder) failed = error; notify(); },
    });
    flushing = false;
    decoder.configure(config);
  }
  function feed() {
    while (next < frames.length && decoder.decodeQueueSize < IN_FLIGHT && ready.length < AHEAD) {
      const sample = next++, type = keys[sample] ? 'key' : 'delta';
      decoder.decode(new EncodedVideoChunk({ type, timestamp: 1000 * frames[sample], data: read(offsets[sample], sizes[sample]) }));
    }
    if (next === frames.length && !flushing) {
      flushing = true;
      decoder.flush().catch(() => {}).finally(notify);
    }
  }
  let at = 0, counts = { decoded: 0 };
  return {
    counts,
    // The planes of a frame (from 1): { width, height, nv12, bytes }. Throws where the browser cannot give it.
    async frame(number) {
      if (!sampleOf.has(number)) throw new Error('there is no such frame');
      if (!decoder || number <= at || number > at + 64) seek(number);
      at = number;
      for (const began = performance.now(); ;) {
        if (failed) throw failed;
        // Those before it were decoded for it alone; what has no place is not shown.
        while (ready.length && ready[0].timestamp < 1000 * number) ready.shift().close();
        if (ready.length) break;
        const came = new Promise(done => { wake = done; setTimeout(done, 200); });
        feed();
        await came;
        if (performance.now() - began > 5000) throw new Error('the browser gave no frame');
      }
      const picture = ready.shift();
      try {
        if (picture.timestamp !== 1000 * number) throw new Error(`the browser left frame ${number} out`);
        if (picture.format !== 'I420' && picture.format !== 'NV12') throw new Error(`frames are ${picture.format}`);
        const bytes = new Uint8Array(picture.allocationSize());
        await picture.copyTo(bytes);
        counts.decoded++;
        const { width, height } = picture.visibleRect;
        return { width, height, nv12: picture.format === 'NV12', bytes };
      } finally { picture.close(); }
    },
    close: stop,
  };
}

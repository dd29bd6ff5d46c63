// The tracker in this page, in the place of a server: a worker with the WebAssembly. Videos that it cannot decode, and cameras,
// give their frames through `source.js`.
function threadOf() {
  const worker = new Worker('worker.js', { type: 'module' }), waiting = new Map();
  let last = 0;
  const fail = error => { for (const [, { no }] of waiting) no(error); waiting.clear(); };
  worker.onmessage = ({ data: { id, value, error } }) => {
    const { yes, no } = waiting.get(id);
    waiting.delete(id);
    error ? no(new Error(error)) : yes(value);
  };
  worker.onerror = () => fail(new Error('The tracker could not be started; this browser may be too old for it (WebAssembly with SIMD is needed).'));
  return (does, message = {}, transfer = []) => new Promise((yes, no) => {
    waiting.set(++last, { yes, no });
    worker.postMessage({ ...message, id: last, does }, transfer);
  });
}

function localTracker() {
  const thread = threadOf(), chosen = new Map(), opened = new Map(), links = new Map();
  let fileCount = 0;
  const message = (message, give) => thread('ask', { message, give });
  const forgetLinks = () => { for (const url of links.values()) URL.revokeObjectURL(url); links.clear(); };

  async function open(path) {
    const { name, files, truth, camera } = chosen.get(path);
    if (camera) return openSource(name, await cameraSource());
    const give = [...files, ...(truth ? [truth] : [])].map(file => [fileCount++, file]);
    const described = give.map(([id, file]) => ({ id, name: file.name, size: file.size }));
    let about;
    try {
      about = await message({ op: 'open', name, files: described.slice(0, files.length), truth: truth ? described[files.length] : null }, give);
    } catch (error) {
      thread('forget', { ids: give.map(([id]) => id) });
      // What our decoder does not know the browser may.
      if (files.length > 1 || /^image\//.test(files[0].type)) throw error;
      let source;
      try { source = await elementSource(files[0]); } catch { throw new Error(`${error.message}; and this browser cannot decode it either`); }
      return openSource(name, source);
    }
    opened.set(about.session, { ...about, ids: give.map(([id]) => id) });
    return about;
  }
  async function openSource(name, source) {
    const { width, height, rate } = source;
    const about = await message({ op: 'live', name, width, height, rate });
    opened.set(about.session, { ...about, source, count: 0 });
    return { ...about, reader: source.reader, frames: source.frames || null, exact: false, live: source.live };
  }
  // The next frame of a source, to the tracker; and as a picture for the page.
  async function next(session, wanted) {
    const video = opened.get(session), frame = await video.source.next();
    if (!frame) return null;
    const picture = wanted ? await createImageBitmap(frame.pixels) : null;
    const pixels = frame.pixels.data.buffer;
    video.count = await thread('push', { session, pixels, time: frame.time, missed: frame.missed }, [pixels]);
    tellMissed(video.source);
    return { picture };
  }
  const ops = {
    list: async () => ({ entries: [] }),
    open: ({ path }) => open(path),
    async close({ session }) {
      const video = opened.get(session);
      opened.delete(session);
      forgetLinks();
      video?.source?.close();
      if (video?.ids) thread('forget', { ids: video.ids });
      return message({ op: 'close', session });
    },
    async step({ session, frames }) {
      if (!opened.get(session).source) return message({ op: 'step', session, frames });
      // After a correction of an earlier frame there are frames that were not tracked yet.
      if (lastTracked() < opened.get(session).count) return message({ op: 'step', session, frames: 1 });
      // A picture goes to the page with the frame: it is shown at once.
      const got = await next(session, true);
      if (!got) return { rows: [], ended: true };
      keep(pictures, opened.get(session).count, got.picture, KEPT_PICTURES);
      return message({ op: 'step', session, frames: 1 });
    },
    save: ({ session, report }) => { forgetLinks(); return message({ op: 'save', session, report }); },
    async saved({ session }) {
      const answer = await message({ op: 'saved', session });
      for (const name of answer.files || []) {
        const bytes = await thread('file', { session, name });
        links.set(name, URL.createObjectURL(new Blob([bytes], { type: 'application/octet-stream' })));
      }
      return answer;
    },
  };
  return {
    ask: asked => ops[asked.op] ? ops[asked.op](asked) : message(asked),
    async picture(session, frame) {
      const video = opened.get(session);
      if (!video) throw new Error('the video is closed');
      if (video.source) {
        let got = null;
        while (video.count < frame) {
          got = await next(session, video.count + 1 === frame);
          if (!got) throw new Error('the video has no such frame');
        }
        if (got?.picture) return got.picture;
      }
      return thread('picture', { session, frame, width: video.width, height: video.height });
    },
    link: (session, name) => links.get(name),
    // A saved file as text.
    async text(session, name) {
      const bytes = await thread('file', { session, name });
      return bytes && new TextDecoder().decode(bytes);
    },
    // Something that was chosen, for `open`.
    offer(entry) {
      const path = String(chosen.size);
      chosen.set(path, entry);
      return { name: entry.name, path, kind: 'video' };
    },
    size: () => thread('size'),
    // Frames that were not seen.
    missed: session => opened.get(session)?.source?.missed || 0,
  };
}
// In the place of the tracker behind a server.
const remoteTracker = localTracker;

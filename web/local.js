// The tracker in this page, in the place of a server: a worker with the WebAssembly. Videos that it cannot decode, and cameras,
// give their frames through `element.js` and the page's camera.js.
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

// What to do about a video that neither the tracker nor the browser decodes: `why` is the tracker's reason, before what it expected.
function unplayable(name, why) {
  const [problem] = why.split('; '), words = `Neither this page nor this browser can decode ${name}`;
  const convert = `convert it to H.264 in MP4: ffmpeg -i "${name}" -c:v libx264 -pix_fmt yuv420p "${name.replace(/\.\w+$/, '')}-h264.mp4"`;
  if (!/"(hvc1|hev1)"/.test(why)) return `${words}: ${problem}. To track it, ${convert}`;
  return `${words}: its video is HEVC (H.265). Open the page in a browser that plays HEVC, such as Safari, or ${convert}. An iPhone records H.264 if Settings, Camera, Formats is "Most Compatible".`;
}

function localTracker() {
  const thread = threadOf(), chosen = new Map(), opened = new Map(), links = new Map();
  let fileCount = 0;
  const message = (message, give) => thread('ask', { message, give });
  const pushed = pushedVideos(message, (session, { pixels, time, missed }) => {
    const bytes = pixels.data.buffer;
    return thread('push', { session, pixels: bytes, time, missed }, [bytes]);
  });
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
      try { source = await elementSource(files[0]); } catch { throw new Error(unplayable(files[0].name, error.message)); }
      return openSource(name, source);
    }
    opened.set(about.session, { ...about, ids: give.map(([id]) => id) });
    if (files.length === 1 && await thread('decode', { session: about.session, file: give[0][0] })) about.reader = 'H.264 (the browser)';
    return about;
  }
  async function openSource(name, source) {
    const about = await pushed.open(name, source);
    opened.set(about.session, about);
    return about;
  }
  const ops = {
    list: async () => ({ entries: [] }),
    open: ({ path }) => open(path),
    async close({ session }) {
      const video = opened.get(session);
      opened.delete(session);
      forgetLinks();
      pushed.close(session);
      if (video?.ids) thread('forget', { ids: video.ids });
      return message({ op: 'close', session });
    },
    step: ({ session, frames }) => pushed.has(session) ? pushed.step(session, frames) : message({ op: 'step', session, frames }),
    save: asked => { forgetLinks(); return message(asked); },
    async saved({ session }) {
      const answer = await message({ op: 'saved', session });
      for (const name of answer.files || []) links.set(name, URL.createObjectURL(await thread('file', { session, name })));
      return answer;
    },
  };
  return {
    ask: asked => ops[asked.op] ? ops[asked.op](asked) : message(asked),
    async picture(session, frame) {
      const video = opened.get(session);
      if (!video) throw new Error('the video is closed');
      const picture = pushed.has(session) ? await pushed.picture(session, frame) : null;
      return picture || thread('picture', { session, frame, width: video.width, height: video.height });
    },
    link: (session, name) => links.get(name),
    // A saved file, and one as text.
    blob: (session, name) => thread('file', { session, name }),
    text: async (session, name) => (await thread('file', { session, name }))?.text(),
    // Something that was chosen, for `open`.
    offer(entry) {
      const path = String(chosen.size);
      chosen.set(path, entry);
      return { name: entry.name, path, kind: 'video' };
    },
    size: () => thread('size'),
    // Frames that were not seen; those that the browser decoded, and why it does no longer.
    missed: session => pushed.missed(session),
    decoded: session => thread('decoded', { session }),
  };
}
// In the place of the tracker behind a server.
const remoteTracker = localTracker;

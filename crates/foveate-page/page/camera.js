// Frames that the page has and the tracker has not: a camera's newest one. `next()` gives { pixels, time, missed }, or null at the end;
// `missed` counts the frames before it that were never seen.
function grabber(video, width, height) {
  const canvas = new OffscreenCanvas(width, height), context = canvas.getContext('2d', { willReadFrequently: true });
  return () => {
    context.drawImage(video, 0, 0, width, height);
    return context.getImageData(0, 0, width, height);
  };
}
const silent = () => Object.assign(document.createElement('video'), { muted: true, playsInline: true, preload: 'auto' });

async function cameraSource() {
  if (!navigator.mediaDevices) throw new Error('This page may not use the camera: browsers allow it over HTTPS and on localhost only.');
  let stream;
  try {
    stream = await navigator.mediaDevices.getUserMedia({ audio: false, video: { width: { ideal: 640 }, height: { ideal: 480 }, facingMode: { ideal: 'environment' } } });
  } catch (error) {
    throw new Error(error.name === 'NotAllowedError' ? 'The camera was not allowed. Allow it in the address bar, then choose it again.' : `The camera cannot be used: ${error.message}`);
  }
  const video = silent();
  video.srcObject = stream;
  await video.play();
  const width = video.videoWidth, height = video.videoHeight, grab = grabber(video, width, height);
  let waiting = null, closed = false, seen = 0, missed = 0, total = 0, first = null;
  const source = {
    width, height, rate: stream.getVideoTracks()[0].getSettings().frameRate || 30, reader: 'the camera', live: true,
    get missed() { return total; },
    next: () => new Promise((yes, no) => { closed ? yes(null) : waiting = { yes, no }; }),
    close() { closed = true; waiting?.yes(null); stream.getTracks().forEach(track => track.stop()); video.srcObject = null; },
  };
  stream.getVideoTracks()[0].addEventListener('ended', () => { closed = true; waiting?.yes(null); });
  const arrived = (now, { presentedFrames, mediaTime }) => {
    if (closed) return;
    // Frames that nobody waited for count while it tracks, not while it is paused.
    if (page.playing || page.busy) missed += Math.max(0, presentedFrames - seen - 1);
    seen = presentedFrames;
    if (waiting) {
      const { yes, no } = waiting;
      waiting = null;
      first ??= mediaTime;
      total += missed;
      try { yes({ pixels: grab(), time: mediaTime - first, missed }); } catch (error) { no(error); }
      missed = 0;
    } else if (page.playing || page.busy) missed++;
    video.requestVideoFrameCallback(arrived);
  };
  video.requestVideoFrameCallback(arrived);
  return source;
}

// Shows how many frames were not seen, if any.
function tellMissed({ missed }) {
  byId('missed').textContent = missed ? `${missed} ${missed === 1 ? 'frame was' : 'frames were'} not seen: the tracker was busy or paused, or the browser left ${missed === 1 ? 'it' : 'them'} out.` : '';
  byId('missed').hidden = !missed;
}

// The end of a stream or camera, once it was reached.
function tellEnd() {
  const { live, over } = page.video || {};
  byId('over').textContent = live && over ? `The source ended after frame ${page.ends}.` : '';
  byId('over').hidden = !(live && over);
}

// Videos whose frames the page gives to the tracker, one at a time: `ask` sends it a message, `push(session, frame)` a frame, and
// answers its number.
function pushedVideos(ask, push) {
  const opened = new Map();
  // The next frame of a source, to the tracker; and as a picture for the page.
  async function next(session, wanted) {
    const video = opened.get(session), frame = await video.source.next();
    if (!frame) return null;
    const picture = wanted ? await createImageBitmap(frame.pixels) : null;
    video.count = await push(session, frame);
    tellMissed(video.source);
    return { picture };
  }
  return {
    async open(name, source) {
      const { width, height, rate } = source, about = await ask({ op: 'live', name, width, height, rate });
      opened.set(about.session, { source, count: 0 });
      return { ...about, reader: source.reader, frames: source.frames || null, exact: false, live: source.live };
    },
    has: session => opened.has(session),
    async step(session, frames) {
      // After a correction of an earlier frame there are frames that were not tracked yet.
      if (Math.min(...page.targets.map(lastTracked)) < opened.get(session).count) return ask({ op: 'step', session, frames: 1 });
      // A picture goes to the page with the frame: it is shown at once.
      const got = await next(session, true);
      if (!got) return { targets: page.targets.map(() => ({ rows: [], ended: true })) };
      keep(pictures, opened.get(session).count, got.picture, KEPT_PICTURES);
      return ask({ op: 'step', session, frames: 1 });
    },
    // The picture of a frame that came now; null of one that the tracker has.
    async picture(session, frame) {
      const video = opened.get(session);
      let got = null;
      while (video.count < frame) {
        got = await next(session, video.count + 1 === frame);
        if (!got) throw new Error('the video has no such frame');
      }
      return got?.picture ?? null;
    },
    close(session) {
      opened.get(session)?.source.close();
      opened.delete(session);
    },
    missed: session => opened.get(session)?.source.missed || 0,
  };
}

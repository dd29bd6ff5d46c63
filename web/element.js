// A video file, frame by frame: it is moved to the middle of the next frame each time, so that none is left out while the browser
// plays. Where frames are of unequal length some may be: a gap in their times is counted.
async function elementSource(file) {
  const video = silent(), url = URL.createObjectURL(file);
  const until = (event, start) => new Promise((yes, no) => {
    const end = work => value => { video.removeEventListener(event, good); video.removeEventListener('error', bad); work(value); };
    const good = end(yes), bad = end(() => no(new Error('the browser cannot decode it')));
    video.addEventListener(event, good);
    video.addEventListener('error', bad);
    start();
  });
  const close = () => { video.removeAttribute('src'); video.load(); URL.revokeObjectURL(url); };
  try { await until('loadeddata', () => { video.src = url; }); } catch (error) { close(); throw error; }
  const width = video.videoWidth, height = video.videoHeight;
  if (!width) { close(); throw new Error('no picture'); }
  const grab = grabber(video, width, height);
  // The time of the frame that is shown after a move; null where none came.
  const move = to => new Promise((yes, no) => {
    const handle = video.requestVideoFrameCallback((now, { mediaTime }) => { clearTimeout(late); yes(mediaTime); });
    const late = setTimeout(() => { video.cancelVideoFrameCallback(handle); yes(null); }, 2000);
    video.currentTime = to;
  });
  const start = await move(1e-4) ?? 0;
  // The length of a frame: small moves until another one is shown.
  let long = 0;
  for (let t = start + 1 / 240; t < Math.min(start + 1, video.duration) && !long; t += 1 / 240) {
    const shown = await move(t);
    if (shown !== null && shown > start + 1e-4) long = shown - start;
  }
  long ||= 1 / 30;
  let at = null, total = 0;
  return {
    width, height, rate: 1 / long, frames: Math.max(1, Math.round((video.duration - start) / long)), reader: 'the browser, frame by frame',
    live: false, get missed() { return total; }, close,
    async next() {
      if (at === null) {
        at = await move(start + long / 2) ?? start;
        return { pixels: grab(), time: 0, missed: 0 };
      }
      const to = at + 1.5 * long;
      if (to > video.duration + long / 2) return null;
      const shown = await move(Math.min(to, video.duration));
      if (shown === null || shown <= at + 1e-4) return null;
      const missed = Math.max(0, Math.round((shown - at) / long) - 1);
      total += missed;
      at = shown;
      return { pixels: grab(), time: at - start, missed };
    },
  };
}

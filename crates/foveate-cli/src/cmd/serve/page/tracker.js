// A tracker answers messages: `ask({ op, … })` gives a promise of its answer, `picture(session, frame)` one of a picture, and
// `link(session, name)` is where a saved file can be had. This one is the server that sent the page; whatever else answers the same
// messages, in the page itself or elsewhere, can take its place.
const CAMERA = 'camera';
function remoteTracker() {
  const token = new URLSearchParams(location.search).get('token');
  const headers = token ? { 'X-Foveate-Token': token } : {};
  const query = values => '?' + new URLSearchParams(token ? { ...values, token } : values);
  async function answered(request) {
    let response;
    try { response = await request; } catch { throw new Error('The program foveate does not answer. Is it still running?'); }
    if (response.ok) return response;
    let problem;
    try { problem = (await response.json()).error; } catch { problem = `error ${response.status}`; }
    throw new Error(problem);
  }
  const request = (where, kind, body, more) => fetch(where, { method: 'POST', headers: { ...headers, 'Content-Type': kind }, body, ...more });
  const post = async (where, kind, body) => (await answered(request(where, kind, body))).json();
  const send = message => post('api', 'application/json', JSON.stringify(message));
  // The browser's own camera: its frames go to the server as JPEG.
  const pushed = pushedVideos(send, async (session, { pixels, time, missed }) => {
    const canvas = new OffscreenCanvas(pixels.width, pixels.height);
    canvas.getContext('2d').putImageData(pixels, 0, 0);
    const picture = await canvas.convertToBlob({ type: 'image/jpeg', quality: .92 });
    return (await post('push' + query({ session, time, missed }), 'image/jpeg', picture)).frame;
  });
  return {
    async ask(message) {
      if (message.op === 'open' && message.path === CAMERA) return pushed.open('camera', await cameraSource());
      if (message.op === 'step' && pushed.has(message.session)) return pushed.step(message.session, message.frames);
      if (message.op === 'close') pushed.close(message.session);
      return send(message);
    },
    async picture(session, frame) {
      const now = pushed.has(session) ? await pushed.picture(session, frame) : null;
      return now || createImageBitmap(await (await answered(fetch('frame' + query({ session, frame }), { headers }))).blob());
    },
    link: (session, name) => 'file' + query({ session, name }),
    // Closes a video though the page is going away.
    leave: session => { request('api', 'application/json', JSON.stringify({ op: 'close', session }), { keepalive: true }).catch(() => {}); },
  };
}

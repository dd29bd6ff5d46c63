// A tracker answers messages: `ask({ op, … })` gives a promise of its answer, `picture(session, frame)` one of a picture, and
// `link(session, name)` is where a saved file can be had. This one is the server that sent the page; whatever else answers the same
// messages, in the page itself or elsewhere, can take its place.
function remoteTracker() {
  const token = new URLSearchParams(location.search).get('token');
  const headers = token ? { 'X-Foveate-Token': token } : {};
  const query = values => '?' + new URLSearchParams(token ? { ...values, token } : values);
  async function told(request) {
    let response;
    try { response = await request; } catch { throw new Error('The program foveate does not answer. Is it still running?'); }
    if (response.ok) return response;
    let problem;
    try { problem = (await response.json()).error; } catch { problem = `error ${response.status}`; }
    throw new Error(problem);
  }
  return {
    ask: async message => (await told(fetch('api', { method: 'POST', headers: { ...headers, 'Content-Type': 'application/json' }, body: JSON.stringify(message) }))).json(),
    picture: async (session, frame) => createImageBitmap(await (await told(fetch('frame' + query({ session, frame }), { headers }))).blob()),
    link: (session, name) => 'file' + query({ session, name }),
  };
}

// What the replays of one target and of many share.
addEventListener('error', event => {
  const notice = document.createElement('p');
  notice.className = 'message';
  notice.textContent = `This page's script failed: ${event.message} (line ${event.lineno}). The numbers are in the CSV files beside it.`;
  document.body.prepend(notice);
});
const data = JSON.parse(document.getElementById('data').textContent);
const picture = text => { const image = new Image(); image.src = 'data:image/jpeg;base64,' + text; return image; };

// The transport of a replay with `count` pictures: play, step, scrub, speed. `now` is the picture shown; `draw` draws it.
// `lasts(k)` is how long picture k stays, seconds; `find(frame)` the picture of a frame; `first` the one the page opens with;
// `key` takes other keys. Play begins at the beginning.
let now = 0;
function transport({ count, draw, lasts, find, first, key = () => false }) {
  const icons = { play: '<svg viewBox="0 0 16 16"><path d="M4 2.5v11l9.5-5.5z"/></svg>', pause: '<svg viewBox="0 0 16 16"><path d="M3.5 2.5h3.2v11H3.5zM9.3 2.5h3.2v11H9.3z"/></svg>' };
  const rates = [.1, .25, .5, 1, 2, 4, 8];
  let playing = false, touched = false, rate = 1, before = 0, due = 0;
  function show(k) {
    now = Math.min(count - 1, Math.max(0, k));
    byId('scrub').value = now;
    if (count) draw();
  }
  function play() {
    if (playing || count < 2) return;
    if (!touched || now === count - 1) show(0);
    playing = touched = true; before = performance.now(); due = 0;
    button();
    requestAnimationFrame(tick);
  }
  function pause() { touched = true; if (playing) { playing = false; button(); } }
  function go(k) { pause(); show(k); }
  function button() {
    byId('play').replaceChildren(drawing(playing ? icons.pause : icons.play));
    byId('play').setAttribute('aria-label', playing ? 'Pause' : 'Play');
  }
  function tick(time) {
    if (!playing) return;
    due += rate * Math.max(0, time - before) / 1000;
    before = time;
    let next = now;
    const stays = k => Math.max(.004, lasts(k));
    while (next + 1 < count && due >= stays(next)) { due -= stays(next); next++; }
    if (next !== now) show(next);
    if (now === count - 1) pause(); else requestAnimationFrame(tick);
  }
  const faster = by => { rate = rates[Math.min(rates.length - 1, Math.max(0, rates.indexOf(rate) + by))]; byId('speed').value = rate; };
  byId('speed').append(...rates.map(r => element('option', { value: r }, `${r}×`)));
  byId('speed').addEventListener('change', event => { rate = +event.target.value; });
  byId('scrub').max = Math.max(0, count - 1);
  byId('scrub').addEventListener('input', event => go(+event.target.value));
  byId('play').addEventListener('click', () => playing ? pause() : play());
  byId('back').addEventListener('click', () => go(now - 1));
  byId('forth').addEventListener('click', () => go(now + 1));
  document.addEventListener('keydown', event => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === 'SELECT') return;
    const onButton = document.activeElement?.matches('button, summary, input[type=checkbox]'), far = event.shiftKey ? 10 : 1;
    const to = { ArrowLeft: now - far, ArrowRight: now + far, Home: 0, End: count - 1 }[event.key];
    if (to !== undefined) go(to);
    else if (event.key === ' ' && !onButton) { if (playing) pause(); else play(); }
    else if (event.key === '+' || event.key === '=') faster(1);
    else if (event.key === '-') faster(-1);
    else if (!key(event.key)) return;
    event.preventDefault();
  });
  function open() {
    const wish = /frame=(\d+)/.exec(location.hash);
    if (wish) touched = true;
    show(wish ? find(+wish[1]) : first);
  }
  window.addEventListener('hashchange', open);
  faster(0);
  button();
  return { show, pause, open };
}

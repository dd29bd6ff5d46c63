// The reward surface over the template: mean and standard deviation of the reward of each gaze.
// The ramp is that of heat.rs: indigo, violet, rose, pale yellow; brighter all the way.
const STOPS = [[26, 16, 70], [111, 71, 230], [224, 82, 143], [255, 236, 130]];
const heat = t => { t = 3 * Math.min(1, Math.max(0, t)); const i = Math.min(2, Math.floor(t)); return STOPS[i].map((from, c) => Math.round(from + (t - i) * (STOPS[i + 1][c] - from))); };

const land = data.surface && (() => {
  const [points, reach] = data.surface, RECENT_GAZES = 100;
  // One scale for the whole run, so that colours can be compared while it plays; the wildest tenth of the pictures (the
  // first ones, as a rule) may go beyond it.
  const whole = which => {
    const spans = keys.filter(key => key.surface).map(key => key.surface[which]);
    const at = (end, share) => spans.map(span => span[end]).sort((a, b) => a - b)[Math.round(share * (spans.length - 1))];
    return [at(0, .1), at(1, .9)];
  };
  const maps = ['mean', 'sd'].map(of => ({ of, span: whole(of + '_span'), pictures: keys.map(() => null), values: keys.map(() => null) }));
  const valuesAt = (map, k) => {
    const found = keys[k].surface;
    if (!found) return null;
    const [low, high] = found[map.of + '_span'];
    return map.values[k] = map.values[k] || Array.from(bytes(found[map.of]), b => low + b / 255 * (high - low));
  };
  const pictureAt = (map, k) => {
    if (map.pictures[k]) return map.pictures[k];
    const values = valuesAt(map, k), made = document.createElement('canvas'), [low, high] = map.span;
    made.width = made.height = points;
    const c = made.getContext('2d'), pixels = c.createImageData(points, points);
    values.forEach((v, i) => pixels.data.set([...heat((v - low) / Math.max(1e-12, high - low)), 255], 4 * i));
    c.putImageData(pixels, 0, 0);
    return map.pictures[k] = made;
  };
  const read = (map, k, u, v) => {
    const values = valuesAt(map, k), at = x => (x / reach + 1) / 2 * (points - 1), x = at(u), y = at(v);
    if (!values || !(x >= 0 && y >= 0 && x <= points - 1 && y <= points - 1)) return null;
    const i = Math.min(points - 2, Math.floor(x)), j = Math.min(points - 2, Math.floor(y)), f = x - i, g = y - j, line = j => (1 - f) * values[j * points + i] + f * values[j * points + i + 1];
    return (1 - g) * line(j) + g * line(j + 1);
  };

  // The uncertainty beside the mean, and a scale below each.
  const second = element('canvas', { role: 'img', 'aria-label': 'Standard deviation of the reward, over the template' });
  const captions = [byId('template-caption'), element('figcaption')];
  document.querySelector('.policy').classList.remove('wide');
  byId('arms').className = '';
  byId('arms').append(element('figure', {}, second, captions[1]));
  const scale = (map, name) => {
    const bar = element('i', { class: 'scale' });
    bar.style.background = `linear-gradient(90deg, ${STOPS.map(s => `rgb(${s})`).join(', ')})`;
    return element('span', { class: 'scaled' }, element('b', {}, say(map.span[0])), bar, element('b', {}, say(map.span[1])), element('span', {}, name));
  };
  const canvases = [byId('template'), second], reading = element('span', { class: 'reading' });
  captions.forEach((caption, i) => caption.replaceChildren(scale(maps[i], i ? 'sd' : 'mean reward')));
  document.querySelector('.where').append(element('p', { class: 'note' }, `Dots: the last ${RECENT_GAZES} gazes. Ring: the gaze with the largest mean. `, reading));

  let places = null, pointer = null;
  const tell = () => {
    if (!pointer) { reading.textContent = ''; return; }
    const [u, v] = pointer, [mean, sd] = maps.map(map => read(map, now, u, v));
    reading.textContent = mean === null ? '' : `At (${say(u, 2)}, ${say(v, 2)}): ${say(mean)} ± ${say(sd, 2)}`;
  };
  canvases.forEach(canvas => {
    canvas.addEventListener('pointermove', event => {
      const box = canvas.getBoundingClientRect();
      pointer = places && places(event.clientX - box.left, event.clientY - box.top);
      tell();
    });
    canvas.addEventListener('pointerleave', () => { pointer = null; tell(); });
  });

  // One map on a context, `at` from half-boxes to its pixels.
  function paint(c, at, i) {
    if (!keys[now].surface) return;
    const [left, top] = at(-reach, -reach), [right, low] = at(reach, reach), half = [(right - left), (low - top)].map(long => long / (points - 1) / 2);
    c.save();
    c.beginPath(); c.rect(left, top, right - left, low - top); c.clip();
    c.globalAlpha = .68;
    c.imageSmoothingEnabled = true; c.imageSmoothingQuality = 'high';
    // The outermost points lie on the edge of the square: half a cell is beyond it.
    c.drawImage(pictureAt(maps[i], now), left - half[0], top - half[1], right - left + 2 * half[0], low - top + 2 * half[1]);
    c.restore();
    const row = keys[now].row, recent = [];
    for (let r = row; r >= 0 && recent.length < RECENT_GAZES; r--) if (series.u[r] !== null) recent.push([series.u[r], series.v[r]]);
    for (const gaze of recent.reverse()) {
      const [x, y] = at(...gaze);
      c.beginPath(); c.arc(x, y, 1.8, 0, 7); c.fillStyle = '#fff'; c.fill();
      c.strokeStyle = 'rgb(0 0 0 / .6)'; c.lineWidth = .8; c.stroke();
    }
    const best = keys[now].surface.best;
    if (best) {
      const [x, y] = at(...best);
      for (const [ink, thick] of [['#000', 4.5], ['#fff', 2]]) { c.strokeStyle = ink; c.lineWidth = thick; c.beginPath(); c.arc(x, y, 7.5, 0, 7); c.stroke(); }
    }
  }
  function beside(size, draw, from) {
    places = from;
    const c = sharp(second, size, size);
    c.clearRect(0, 0, size, size);
    draw(c);
    tell();
  }
  return { paint, beside };
})();

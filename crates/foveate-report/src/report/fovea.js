// What the fovea sees: the glimpse, the template there, their difference, and the encoder's features.
const eye = eyeOf(data.cells);

const hex = text => [1, 3, 5].map(i => parseInt(text.slice(i, i + 2), 16));

function drawFovea() {
  const key = keys[now], row = key.row;
  if (series.distance[row] === null) byId('distance').textContent = 'initialised here';
  else byId('distance').replaceChildren('distance ', element('b', {}, say(series.distance[row])));
  if (!eye) return;
  const seen = bytes(key.glimpse), template = bytes(key.template);
  drawGlimpse(byId('seen'), eye, seen);
  drawGlimpse(byId('expected'), eye, template);
  const [flat, darker, brighter] = ['flat', 'darker', 'brighter'].map(name => hex(colour(name)));
  paintGlimpse(byId('difference'), eye, i => {
    const cell = eye.maps[0][i];
    if (cell < 0 || !seen.length || !template.length) return null;
    const gap = (seen[cell] - template[cell]) / 110, t = Math.min(1, Math.abs(gap));
    return flat.map((c, p) => c + t * ((gap < 0 ? darker : brighter)[p] - c));
  });
  drawFeatures(key);
}

// hₜ as a strip of units, or a square where there is room: column by column, the bluer the more active.
function drawFeatures(key) {
  const values = bytes(key.features), figure = byId('features').parentElement;
  figure.hidden = !data.features;
  if (!data.features) return;
  const high = Math.max(1, Math.round(Math.sqrt(data.features / (fixed ? 1 : 10)))), wide = Math.ceil(data.features / high);
  const canvas = byId('features');
  canvas.width = wide; canvas.height = high;
  const context = canvas.getContext('2d'), out = context.createImageData(wide, high);
  const [low, full] = [hex(colour('flat')), hex(colour('target'))];
  values.forEach((v, i) => {
    const at = 4 * ((i % high) * wide + Math.floor(i / high)), t = v / 255;
    out.data.set([...low.map((c, p) => c + t * (full[p] - c)), 255], at);
  });
  context.putImageData(out, 0, 0);
  byId('features-caption').textContent = `${counted(data.features, 'activation')} of the encoder` + (key.span ? `, from ${say(key.span[0])} to ${say(key.span[1])}` : '');
}

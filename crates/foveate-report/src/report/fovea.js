// Glimpses, drawn cell by cell. A raster whose pixels are the smallest cells says which cell is seen where.
const eye = (() => {
  const n = data.cells.length / 4;
  if (!n) return null;
  const cells = Array.from({ length: n }, (_, i) => data.cells.slice(4 * i, 4 * i + 4));
  const reach = Math.max(...cells.map(([u, v, half]) => Math.max(Math.abs(u), Math.abs(v)) + half));
  const finest = Math.min(...cells.map(cell => cell[2]));
  const side = Math.min(192, Math.max(1, Math.round(reach / finest)));
  const maps = [0, 1, 2].map(() => new Int32Array(side * side).fill(-1));
  cells.forEach(([u, v, half, channel], i) => {
    const from = x => Math.max(0, Math.round((x - half + reach) / (2 * reach) * side));
    const to = x => Math.min(side, Math.round((x + half + reach) / (2 * reach) * side));
    for (let y = from(v); y < to(v); y++) for (let x = from(u); x < to(u); x++) maps[channel][y * side + x] = i;
  });
  return { side, maps };
})();

// What the retina's channels say of a colour: grey is BT.601 luma, then (red − green) / 2, (2 blue − red − green) / 4.
function colourOf(values, pixel) {
  const [grey, rg, by] = eye.maps.map(map => map[pixel]);
  if (grey < 0) return null;
  const y = values[grey], a = rg < 0 ? 0 : 2 * (values[rg] - 128), b = by < 0 ? 0 : 4 * (values[by] - 128);
  const green = y - .356 * a - .057 * b;
  return [green + a, green, (b + 2 * green + a) / 2];
}

function paintGlimpse(id, pixelOf) {
  const canvas = byId(id);
  canvas.width = canvas.height = eye.side;
  const context = canvas.getContext('2d'), out = context.createImageData(eye.side, eye.side);
  for (let i = 0; i < eye.side * eye.side; i++) {
    const rgb = pixelOf(i);
    if (rgb) out.data.set([...rgb, 255], 4 * i);
  }
  context.putImageData(out, 0, 0);
}

const hex = text => [1, 3, 5].map(i => parseInt(text.slice(i, i + 2), 16));

function drawFovea() {
  const key = keys[now], row = key.row;
  if (series.distance[row] === null) byId('distance').textContent = 'initialised here';
  else byId('distance').replaceChildren('distance ', element('b', {}, say(series.distance[row])));
  if (!eye) return;
  const seen = bytes(key.glimpse), template = bytes(key.template);
  const paint = (id, values) => paintGlimpse(id, i => values.length ? colourOf(values, i) : null);
  paint('seen', seen);
  paint('expected', template);
  const [flat, darker, brighter] = ['flat', 'darker', 'brighter'].map(name => hex(colour(name)));
  paintGlimpse('difference', i => {
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
  byId('features-caption').textContent = `${data.features} activations of the encoder` + (key.span ? `, from ${say(key.span[0])} to ${say(key.span[1])}` : '');
}

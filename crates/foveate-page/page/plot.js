// Charts over time, as SVG with axes and units.
const PLOT = { height: 176, left: 58, right: 12, top: 26, bottom: 34 };
let plotCount = 0;
// Round numbers from `low` to `high`, about `most` of them, and their decimal places.
function roundTicks(low, high, most) {
  const least = (high - low) / most, ten = 10 ** Math.floor(Math.log10(least));
  const step = [1, 2, 5, 10].map(factor => factor * ten).find(step => step >= .999 * least), ticks = [];
  for (let k = Math.ceil(low / step - 1e-6); k * step <= high + 1e-6 * step && ticks.length < 30; k++) ticks.push(k * step);
  return { ticks, places: Math.max(0, -Math.floor(Math.log10(step) + 1e-6)) };
}
const tickText = (value, { ticks, places }) => places > 5 || Math.max(...ticks.map(Math.abs)) >= 1e6 ? value.toExponential(1).replace('-', '−') : say(value, places);
// The range of the numbers and of most of their band.
function rangeOf(values, sd) {
  const known = values.filter(Number.isFinite);
  let low = Math.min(...known), high = Math.max(...known);
  const wide = [...sd].filter(Number.isFinite).sort((a, b) => a - b)[Math.floor(.9 * sd.length)] || 0;
  const more = Math.max(.08 * (high - low), 2.1 * wide, 1e-9 * Math.abs(high), 1e-12);
  [low, high] = [low - more, high + more];
  return known.length && Number.isFinite(high - low) ? [low, high] : null;
}
// A chart `width` wide: `value` and its standard errors `sd` at `times`, `dots` and a `curve` of [t, v]; `span` is the range of t.
function plot({ label, times, value, sd = [], dots = [], curve = [], span, ink, width }) {
  const { height, left, right, top, bottom } = PLOT, range = rangeOf([...value, ...dots.map(dot => dot[1])], sd);
  if (!range) return element('p', { class: 'note' }, `${label}: too large to draw`);
  const x = t => left + (t - span[0]) / (span[1] - span[0]) * (width - left - right), y = v => height - bottom - (v - range[0]) / (range[1] - range[0]) * (height - top - bottom);
  const place = (t, v) => `${x(t).toFixed(1)} ${Math.max(-1e4, Math.min(1e4, y(v))).toFixed(1)}`, good = ([t, v]) => Number.isFinite(t) && Number.isFinite(v);
  const path = points => points.filter(good).map((point, i) => (i ? 'L' : 'M') + place(...point)).join('');
  const line = times.map((t, i) => [t, value[i]]), edge = sign => line.map(([t, v], i) => [t, v + sign * 1.96 * sd[i]]);
  const across = roundTicks(...span, Math.max(3, (width - left) / 90)), up = roundTicks(...range, 5), foot = height - bottom;
  const grid = up.ticks.map(v => `<path class="grid" d="M${left} ${y(v).toFixed(1)}H${width - right}"/><text x="${left - 6}" y="${(y(v) + 4).toFixed(1)}" text-anchor="end">${tickText(v, up)}</text>`).join('')
    + across.ticks.map(t => `<path class="grid" d="M${x(t).toFixed(1)} ${top}V${foot}"/><text x="${x(t).toFixed(1)}" y="${foot + 15}" text-anchor="middle">${tickText(t, across)}</text>`).join(''), clip = `clip-${++plotCount}`;
  const made = drawing(`<svg class="motion ${ink}" viewBox="0 0 ${width} ${height}" width="${width}" height="${height}" role="img"><clipPath id="${clip}"><path d="M${left} ${top}H${width - right}V${foot}H${left}z"/></clipPath>${grid}
    <g clip-path="url(#${clip})">${sd.length ? `<path class="band" d="${path([...edge(1), ...edge(-1).reverse()])}z"/>` : ''}<path class="series" d="${path(line)}"/>
    <path class="dots" d="${dots.filter(good).map(dot => `M${place(...dot)}h0`).join('')}"/><path class="fit" d="${path(curve)}"/><path class="chosen" d=""/><path class="cursor" d=""/></g>
    <text class="name" x="${left}" y="15"></text><text x="${width - right}" y="${height - 3}" text-anchor="end">t (s)</text></svg>`);
  made.querySelector('.name').textContent = label;
  made.setAttribute('aria-label', `${label} over time`);
  const timeAt = event => {
    const area = made.getBoundingClientRect();
    return span[0] + Math.max(0, Math.min(1, ((event.clientX - area.left) / area.width * width - left) / (width - left - right))) * (span[1] - span[0]);
  };
  const stripe = (from, to) => `M${x(from).toFixed(1)} ${top}H${x(to).toFixed(1)}V${foot}H${x(from).toFixed(1)}z`;
  return Object.assign(made, {
    timeAt,
    choose: (from, to) => made.querySelector('.chosen').setAttribute('d', from === null ? '' : stripe(from, to)),
    mark: t => made.querySelector('.cursor').setAttribute('d', t === null ? '' : `M${x(t).toFixed(1)} ${top}V${foot}`),
  });
}

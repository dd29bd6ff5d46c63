// Time series that share one cursor.
const degrees = series.angle.map(a => a === null ? null : a * 180 / Math.PI);
const scale = series.log_scale.map(s => s === null ? null : Math.exp(s));
const shape = series.log_aspect.map(a => a === null ? null : Math.exp(a));
const speed = series.vx.map((vx, i) => vx === null ? null : Math.hypot(vx, series.vy[i]));
const chartList = [
  { title: 'Reward', unit: '0 to 1', lines: [{ of: series.reward, name: 'chosen', ink: 'gaze' }], band: series.reward_low.some((v, i) => v !== series.reward_high[i]) && [series.reward_low, series.reward_high], bandName: 'all gazes' },
  { title: 'Effective sample size', unit: 'particles', log: true, from: 1, to: data.particles, lines: [{ of: series.ess, ink: 'target' }], mark: [data.particles, `all ${data.particles}`] },
  { title: 'Log evidence', unit: 'nats', lines: [{ of: series.log_evidence, ink: 'second' }] },
  { title: 'P(lost)', from: 0, to: 1, lines: [{ of: series.p_lost, ink: 'lost' }], shade: lostRuns.length > 0 },
  { title: 'Distance to the template', from: 0, lines: [{ of: series.distance, ink: 'second' }] },
  { title: 'Position uncertainty', unit: 'px (1 sd)', from: 0, lines: [{ of: series.sd_x, name: 'x', ink: 'target' }, { of: series.sd_y, name: 'y', ink: 'third', dash: true }] },
  { title: 'Speed', unit: 'px/frame', from: 0, lines: [{ of: speed, ink: 'target' }] },
  { title: 'Scale', unit: '× first frame', least: .1, lines: [{ of: scale, ink: 'target' }] },
  { title: 'Width / height', unit: '× first frame', least: .1, lines: [{ of: shape, ink: 'target' }] },
  { title: 'Angle', unit: 'degrees', least: 10, lines: [{ of: degrees, ink: 'target' }] },
];
const known = series.true_x.some(x => x !== null);
// Where the truth is known, the centre error takes the place of the distance, which the panel above shows as well.
if (known) {
  chartList.splice(4, 1);
  const off = (xs, ys) => series.true_x.map((x, i) => x === null || xs[i] === null ? null : Math.hypot(x - xs[i], series.true_y[i] - ys[i]));
  const lines = [{ of: off(series.x, series.y), ink: data.baselines.length ? 'target' : 'second' }];
  data.baselines.forEach(({ name, x, y }, i) => lines.push({ of: off(x, y), name, ink: ['baseline', 'third'][i], dash: true }));
  chartList.unshift({ title: 'Centre error', unit: 'px', from: 0, lines });
}
if (!arms.length && !fixed) chartList.splice(1, 0, { title: 'Gaze', unit: 'half-boxes', lines: [{ of: series.u, name: 'u', ink: 'gaze' }, { of: series.v, name: 'v', ink: 'target', dash: true }] });
// Regret is known where fixed gazes were scored beside the policy's own.
if (data.regret) {
  const { total, random, reward } = data.regret;
  const first = chartList.find(chart => chart.title === 'Reward');
  first.lines.push({ of: reward, name: 'best fixed', ink: 'second', dash: true });
  chartList.splice(chartList.indexOf(first) + 1, 0, { title: 'Regret', unit: 'cumulative', lines: [{ of: total, name: 'policy', ink: 'gaze' }, { of: random, name: 'random', ink: 'soft', dash: true }] });
}
// The classes, if there is a recogniser.
if (data.classes) {
  const inks = ['target', 'gaze', 'second', 'third', 'lost', 'soft'];
  chartList.unshift({ title: 'Class', unit: 'probability, all frames so far', from: 0, to: 1, lines: data.classes.map(({ name, of }, i) => ({ name, of, ink: inks[i], dash: i > 0 })) });
}
for (let i = chartList.length; i-- > 0;) if (chartList[i].lines.every(({ of }) => of.every(v => v === null))) chartList.splice(i, 1);
byId('charts').hidden = !chartList.length;
const HEIGHT = 128, RIGHT = 12, TOP = 8, BOTTOM = 20, LABEL = '10.5px system-ui, "DejaVu Sans", sans-serif';
const ruler = document.createElement('canvas').getContext('2d');
const widthOf = text => { ruler.font = LABEL; return ruler.measureText(text).width; };
// Room left of the plots: as much as the widest label of all value axes needs.
let left = 44;

// The least round step of at least `raw`: 1, 2 or 5 times a power of ten.
function roundStep(raw) {
  const power = 10 ** Math.floor(Math.log10(raw));
  return [1, 2, 5, 10].map(m => m * power).find(s => s >= raw * .999);
}
// Round values that cover a span with about four lines, and their labels.
function ticks(low, high) {
  const step = roundStep((high - low) / 4), places = Math.max(0, -Math.floor(Math.log10(step) + 1e-9)), out = [];
  for (let t = Math.ceil(low / step - 1e-9) * step; t <= high + step * 1e-6; t += step) out.push(Math.abs(t) < step * 1e-9 ? 0 : t);
  return out.map(at => ({ at, text: at.toFixed(places).replace('-', '−') }));
}
// Frame numbers under a time axis of `room` pixels: the last one with the word, and before it round ones in steps that are
// wider than any label.
function frameTicks(room) {
  const first = series.frame[0], last = series.frame[rows - 1], end = `frame ${last}`, gap = 12;
  const step = Math.max(1, roundStep(Math.max(widthOf(String(last)) + gap, 56) * (last - first + 1) / room));
  const out = [{ at: 1, text: end, anchor: 'end' }];
  for (let frame = Math.ceil(first / step) * step; frame < last; frame += step) {
    const at = (series.frame.findIndex(value => value >= frame) + .5) / rows, text = String(frame);
    if (at * room + widthOf(text) / 2 + gap <= room - widthOf(end)) out.push({ at, text, anchor: 'middle' });
  }
  return out;
}

for (const chart of chartList) {
  chart.values = element('p', { class: 'value' });
  chart.plot = element('div', { class: 'plot' });
  const title = element('h2', {}, chart.title, element('span', {}, chart.unit || ''));
  byId('charts').append(element('figure', { class: 'card chart' }, element('div', { class: 'head' }, title, chart.values), chart.plot));
  scrubOver(chart.plot, () => left, () => chart.plot.clientWidth - left - RIGHT);
  chart.spans = chart.lines.map(line => {
    const value = element('b'), mark = element('i', { class: 'swatch' + (line.dash ? ' dash' : '') });
    mark.style.setProperty('--c', `var(--${line.ink})`);
    chart.values.append(element('span', {}, mark, ...(line.name ? [line.name + ' '] : []), value));
    return value;
  });
  if (chart.shade) chart.values.prepend(element('span', {}, element('i', { class: 'swatch shade' }), 'occluded or lost'));
  if (chart.band) {
    const mark = element('i', { class: 'swatch band' });
    mark.style.setProperty('--c', `var(--${chart.lines[0].ink})`);
    chart.values.prepend(element('span', {}, mark, chart.bandName));
  }
}

// Moving over a time axis moves the replay.
function scrubOver(plot, left, room) {
  const move = event => {
    if (event.type === 'pointermove' && event.pointerType === 'touch' && !event.buttons) return;
    const x = event.clientX - plot.getBoundingClientRect().left - left();
    const row = Math.min(rows - 1, Math.max(0, Math.floor(x / room() * rows)));
    pause();
    show(nearestKey(row));
  };
  plot.addEventListener('pointermove', move);
  plot.addEventListener('pointerdown', move);
}

// A line of at most two points a pixel: the least and the greatest value of each column.
function pathOf(values, x, y, columns) {
  let d = '', open = false;
  const bundle = Math.max(1, Math.floor(values.length / (2 * columns)));
  for (let i = 0; i < values.length; i += bundle) {
    let picked = [i];
    if (bundle > 1) {
      let low = -1, high = -1;
      for (let j = i; j < Math.min(i + bundle, values.length); j++) {
        if (values[j] === null) continue;
        if (low < 0 || values[j] < values[low]) low = j;
        if (high < 0 || values[j] > values[high]) high = j;
      }
      picked = low < 0 ? [i] : [...new Set([low, high])].sort((a, b) => a - b);
    }
    for (const j of picked) {
      if (values[j] === null) { open = false; continue; }
      d += `${open ? 'L' : 'M'}${x(j).toFixed(1)} ${y(values[j]).toFixed(1)}`;
      open = true;
    }
  }
  return d;
}

// The range of a chart's values, and the marks of its axis.
function measure(chart) {
  const all = [...chart.lines.map(l => l.of), ...(chart.band || [])].flat().filter(v => v !== null);
  let low = all.reduce((a, b) => Math.min(a, b), Infinity), high = all.reduce((a, b) => Math.max(a, b), -Infinity);
  if (!all.length) [low, high] = [chart.from ?? 0, chart.to ?? 1];
  if (chart.from !== undefined) low = Math.min(low, chart.from);
  if (chart.to !== undefined) high = Math.max(high, chart.to);
  const least = chart.least || Math.max(1e-3, Math.abs(high) * .02);
  if (high - low < least) { const middle = (low + high) / 2; low = chart.from === undefined ? middle - least / 2 : low; high = Math.max(high, low + least); }
  else if (!chart.log) { const air = .06 * (high - low); high += air; if (chart.from === undefined) low -= air; }
  const unit = chart.log ? v => Math.log(Math.max(v, low) / low) / Math.log(high / low) : v => (v - low) / (high - low);
  const powers = [1, 10, 100, 1000, 1e4, 1e5, 1e6].filter(t => t >= low && t <= high);
  Object.assign(chart, { high, unit, marks: chart.log ? powers.map(at => ({ at, text: String(at) })) : ticks(low, high) });
}

function drawCharts() {
  chartList.forEach(measure);
  left = Math.max(44, 12 + Math.max(...chartList.flatMap(chart => chart.marks.map(mark => widthOf(mark.text)))));
  for (const chart of chartList) {
    const width = chart.plot.clientWidth, room = width - left - RIGHT, tall = HEIGHT - TOP - BOTTOM;
    const x = chart.x = row => left + (row + .5) / rows * room, y = chart.y = v => TOP + tall * (1 - chart.unit(v));
    let svg = `<svg width="${width}" height="${HEIGHT}" viewBox="0 0 ${width} ${HEIGHT}" role="img" aria-label="${chart.title}${chart.unit ? `, ${chart.unit},` : ''} over frames">`;
    svg += '<defs><pattern id="hatch" width="6" height="6" patternUnits="userSpaceOnUse" patternTransform="rotate(45)"><rect class="lostbar" width="6" height="6"/><rect class="stripe" width="1.5" height="6"/></pattern></defs>';
    for (const [a, b] of lostRuns) {
      const from = x(a) - room / rows / 2, w = Math.max(1.5, (b - a + 1) / rows * room);
      svg += `<rect x="${from}" y="${TOP}" width="${w}" height="${tall}" fill="url(#hatch)"/><rect class="lostline" x="${from}" y="${TOP + tall - 2}" width="${w}" height="2"/>`;
    }
    for (const { at, text } of chart.marks) svg += `<line class="grid" x1="${left}" x2="${width - RIGHT}" y1="${y(at)}" y2="${y(at)}"/><text x="${left - 7}" y="${y(at) + 3.5}" text-anchor="end">${text}</text>`;
    if (chart.mark && chart.mark[0] <= chart.high) svg += `<line class="reference" x1="${left}" x2="${width - RIGHT}" y1="${y(chart.mark[0])}" y2="${y(chart.mark[0])}"/>`;
    for (const { at, text, anchor } of frameTicks(room)) svg += `<text x="${left + at * room}" y="${HEIGHT - 4}" text-anchor="${anchor}">${text}</text>`;
    if (chart.band) {
      const rowsWith = chart.band[0].map((v, i) => v === null ? -1 : i).filter(i => i >= 0);
      const thin = rowsWith.filter((_, i) => i % Math.max(1, Math.floor(rowsWith.length / (2 * room))) === 0);
      const points = [...thin.map(i => [i, chart.band[1][i]]), ...thin.slice().reverse().map(i => [i, chart.band[0][i]])];
      svg += `<polygon class="band" fill="var(--${chart.lines[0].ink})" points="${points.map(([i, v]) => `${x(i).toFixed(1)},${y(v).toFixed(1)}`).join(' ')}"/>`;
    }
    for (const line of chart.lines) svg += `<path class="series" stroke="var(--${line.ink})" ${line.dash ? 'stroke-dasharray="4 2.5"' : ''} d="${pathOf(line.of, x, y, room)}"/>`;
    svg += `<line class="cursor" y1="${TOP}" y2="${TOP + tall}"/>` + chart.lines.map(line => `<circle class="dot" r="3.6" fill="var(--${line.ink})"/>`).join('') + '</svg>';
    chart.plot.replaceChildren(drawing(svg));
    chart.cursor = chart.plot.querySelector('.cursor');
    chart.dots = chart.plot.querySelectorAll('.dot');
  }
}

function moveCursors() {
  const row = keys[now].row;
  for (const chart of chartList) {
    const x = chart.x(row);
    chart.cursor.setAttribute('x1', x);
    chart.cursor.setAttribute('x2', x);
    chart.lines.forEach((line, i) => {
      const value = line.of[row];
      chart.spans[i].textContent = say(value);
      chart.dots[i].setAttribute('visibility', value === null ? 'hidden' : 'visible');
      if (value !== null) { chart.dots[i].setAttribute('cx', x); chart.dots[i].setAttribute('cy', chart.y(value)); }
    });
  }
}

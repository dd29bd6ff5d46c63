// What stands beside the frame: status, glimpse, policy, P(lost).
function panels() {
  const row = rowOf(page.frame), detail = page.details.get(page.frame);
  const badge = byId('badge');
  badge.textContent = row ? (row.given ? 'box given' : row.status) : page.rows.length ? 'not tracked yet' : 'no box yet';
  badge.className = 'badge' + (row ? row.usable ? ' on' : ' off' : '');
  byId('figures').replaceChildren(...(row ? [`${row.box.slice(0, 2).map(v => say(v + 1, 1)).join(', ')}  ·  ${row.box.slice(2).map(v => say(v, 1)).join(' × ')} px`] : []));
  if (row && row.ess !== null) byId('figures').append('  ·  ', element('abbr', { title: 'How many particles share the weight: few, the estimate is sharp; nearly all, the picture was uninformative.' }, `${say(row.ess, 0)} effective particles`));
  const seconds = row ? row.time : (page.frame - 1) / (page.video.rate || 30);
  byId('clock').replaceChildren(element('b', {}, String(page.frame)), ` of ${Number.isFinite(page.ends) ? page.ends : '?'} · ${say(seconds)} s`);
  byId('screen').setAttribute('aria-label', `Frame ${page.frame}` + (row ? `: ${badge.textContent}, box at ${row.box.map(v => Math.round(v)).join(', ')}` : ''));
  byId('p-lost').replaceChildren(...(row ? [`frame ${page.frame}: `, element('b', {}, say(row.p_lost))] : []));
  byId('distance').replaceChildren(...(row && row.distance !== null ? ['distance to the template ', element('b', {}, say(row.distance))] : []));
  drawGlimpse(byId('seen'), active().eye, detail ? bytes(detail.glimpse) : []);
  drawPolicy(row, detail);
  drawGraph();
  actions();
  doing(measureSoon)();
}

// Gazes and their probabilities, as bars.
function armRows(arms, gaze) {
  const reach = Math.max(1, ...arms.map(([u, v]) => Math.max(Math.abs(u), Math.abs(v))));
  return arms.map(([u, v, p]) => {
    const now = gaze && Math.hypot(gaze[0] - u, gaze[1] - v) < 1e-9;
    const mark = drawing(`<svg viewBox="0 0 20 20" aria-hidden="true"><rect x="1" y="1" width="18" height="18" rx="3" fill="none" stroke="currentColor" opacity=".45"/><circle cx="${10 + 8 * u / reach}" cy="${10 + 8 * v / reach}" r="2.6" fill="currentColor"/></svg>`);
    const bar = element('i');
    bar.style.width = 100 * p + '%';
    return element('div', { class: 'arm' + (now ? ' now' : '') }, mark, element('span', { class: 'bar' }, bar), element('span', { class: 'p' }, say(p)));
  });
}
function drawPolicy(row, detail) {
  const arms = detail?.arms || [], surface = detail?.surface, list = byId('arms'), canvas = byId('rewards');
  canvas.hidden = !surface;
  if (surface) {
    const { side, mean } = surface, low = Math.min(...mean), high = Math.max(...mean);
    canvas.width = canvas.height = side;
    const context = canvas.getContext('2d'), out = context.createImageData(side, side);
    mean.forEach((v, i) => out.data.set([...tint((v - low) / Math.max(1e-12, high - low)), 255], 4 * i));
    context.putImageData(out, 0, 0);
    if (row?.gaze) {
      const place = v => Math.round((v / surface.reach + 1) / 2 * (side - 1));
      context.fillStyle = '#fff';
      context.fillRect(place(row.gaze[0]), place(row.gaze[1]), 1, 1);
    }
  }
  list.replaceChildren(...armRows(arms, row?.gaze));
  const learning = arms.length || surface;
  byId('policy-caption').textContent = !page.policy ? '' : arms.length ? `${page.policy}: how likely each gaze is next`
    : surface ? `${page.policy}: reward of each gaze, brighter is more; white, the gaze` : detail && !learning ? `${page.policy}: nothing to learn. Choose hedge or gp-ucb to watch one that learns.` : page.policy;
}

function drawGraph() {
  const canvas = byId('graph'), width = canvas.clientWidth, height = canvas.clientHeight;
  if (!width || !page.rows.length) return;
  const c = sharp(canvas, width, height), n = page.rows.length, x = i => (i + .5) / Math.max(n, 20) * width, y = p => 2 + (1 - p) * (height - 4);
  c.clearRect(0, 0, width, height);
  const wide = width / Math.max(n, 20);
  c.fillStyle = colour('lostwash');
  page.rows.forEach((row, i) => { if (!row.usable) c.fillRect(x(i) - wide / 2, 0, wide + .5, height); });
  const line = (points, ink, thick, dash = []) => {
    c.beginPath(); points.forEach((p, i) => i ? c.lineTo(...p) : c.moveTo(...p));
    c.setLineDash(dash); c.strokeStyle = ink; c.lineWidth = thick; c.stroke(); c.setLineDash([]);
  };
  line([[0, height - .5], [width, height - .5]], colour('line'), 1);
  line([[0, y(.5)], [width, y(.5)]], colour('soft'), 1, [2, 4]);
  c.fillStyle = colour('target');
  page.rows.forEach((row, i) => { if (row.given) c.fillRect(x(i) - 1.5, height - 10, 3, 10); });
  // No more points than pixels: of each stretch the worst.
  const stretch = Math.max(1, Math.floor(n / width)), points = [];
  for (let i = 0; i < n; i += stretch) points.push([x(i), y(Math.max(...page.rows.slice(i, i + stretch).map(row => row.p_lost ?? 0)))]);
  line(points, colour('lost'), 1.8);
  if (rowOf(page.frame)) line([[x(page.frame - page.first), 0], [x(page.frame - page.first), height]], colour('ink'), 1);
  canvas.setAttribute('aria-label', `Probability that the target is lost in frames ${page.first} to ${lastTracked()}; ${page.rows.filter(row => !row.usable).length} are occluded or lost`);
}
byId('graph').addEventListener('click', doing(async event => {
  const area = byId('graph').getBoundingClientRect();
  pause();
  await show(clamp(page.first + Math.floor((event.clientX - area.left) / area.width * Math.max(page.rows.length, 20)), page.first, lastTracked()));
}));

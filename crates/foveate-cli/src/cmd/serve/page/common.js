const byId = id => document.getElementById(id);
function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}
// SVG from text of our own making; never from what the server says.
function drawing(markup) {
  const holder = document.createElement('template');
  holder.innerHTML = markup;
  return holder.content.firstElementChild;
}
const colour = name => getComputedStyle(document.documentElement).getPropertyValue('--' + name).trim();
const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0));
const say = (value, places = 2) => value === null || value === undefined ? '–' : value.toFixed(places).replace('-', '−');
// A canvas with as many pixels as the screen has for it; drawn in CSS pixels.
function sharp(canvas, width, height) {
  const ratio = window.devicePixelRatio || 1, w = Math.round(width * ratio), h = Math.round(height * ratio);
  if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
  const context = canvas.getContext('2d');
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return context;
}
// Weight relative to the heaviest, to a colour: violet over rose to pale yellow (dark to bright for any eye).
const ramp = [[111, 71, 230], [224, 82, 143], [255, 236, 130]];
const tint = t => {
  const [a, b, f] = t < .5 ? [ramp[0], ramp[1], 2 * t] : [ramp[1], ramp[2], 2 * t - 1];
  return a.map((c, i) => Math.round(c + f * (b[i] - c)));
};
function complain(error) {
  byId('message').textContent = error ? (error.message || String(error)) : '';
  byId('message').hidden = !error;
}
// What a click does; what goes wrong is told.
const doing = work => async event => {
  try { complain(null); await work(event); } catch (error) { complain(error); }
};

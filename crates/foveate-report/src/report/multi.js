// The replay of many targets: frames as pictures, boxes drawn over them.
const { keys } = data;
const canvas = byId('screen'), pen = canvas.getContext('2d');
const zoom = Math.max(1, Math.min(4, Math.round(960 / data.size[0])));
[canvas.width, canvas.height] = data.size.map(side => side * zoom);
// The centre of an image pixel is the centre of its block on the screen.
const place = v => (v + .5) * zoom;

// The numbers of a target: x and y of its four corners, then of its gaze.
function drawTarget(target) {
  const at = i => [place(target.at[2 * i]), place(target.at[2 * i + 1])], corners = [0, 1, 2, 3].map(at);
  pen.strokeStyle = target.colour;
  pen.lineWidth = 2;
  pen.beginPath();
  // Corners alone where it is occluded or lost.
  if (target.corners) corners.forEach(([x, y], i) => {
    const [[ax, ay], [bx, by]] = [corners[(i + 3) % 4], corners[(i + 1) % 4]];
    pen.moveTo(x + .2 * (ax - x), y + .2 * (ay - y));
    pen.lineTo(x, y);
    pen.lineTo(x + .2 * (bx - x), y + .2 * (by - y));
  });
  else { corners.forEach(([x, y], i) => i ? pen.lineTo(x, y) : pen.moveTo(x, y)); pen.closePath(); }
  const [x, y] = at(4);
  pen.moveTo(x - 5, y); pen.lineTo(x + 5, y);
  pen.moveTo(x, y - 5); pen.lineTo(x, y + 5);
  pen.stroke();
  const [left, top] = [0, 1].map(axis => Math.min(...corners.map(corner => corner[axis])));
  pen.font = '600 13px system-ui, "DejaVu Sans", sans-serif';
  const wide = pen.measureText(target.name).width + 8;
  const [lx, ly] = [Math.max(0, Math.min(left, canvas.width - wide)), top > 22 ? top - 20 : top + 4];
  pen.fillStyle = 'rgb(0 0 0 / .6)';
  pen.fillRect(lx, ly, wide, 17);
  pen.fillStyle = target.colour;
  pen.fillText(target.name, lx + 4, ly + 13);
}

const replay = transport({
  count: keys.length,
  first: keys.reduce((best, key, k) => key.targets.length > keys[best].targets.length ? k : best, 0),
  lasts: () => data.every / (data.rate || 30),
  find: frame => { const k = keys.findIndex(key => key.frame >= frame); return k < 0 ? keys.length - 1 : k; },
  draw() {
    const key = keys[now], image = picture(key.jpeg);
    byId('clock').replaceChildren('frame ', element('b', {}, String(key.frame)), ` of ${data.frames} · ${counted(key.targets.length, 'target')}`);
    image.onload = () => {
      if (keys[now] !== key) return;
      pen.imageSmoothingEnabled = canvas.width < 3 * image.naturalWidth;
      pen.drawImage(image, 0, 0, canvas.width, canvas.height);
      key.targets.forEach(drawTarget);
    };
  },
});
replay.open();

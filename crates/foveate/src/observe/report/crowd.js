"use strict";
// The replay of many targets: frames as pictures, boxes drawn over them.
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const [screen, scrub, play, clock] = ["screen", "scrub", "play", "clock"].map((id) => document.getElementById(id));
  const pen = screen.getContext("2d");
  const zoom = Math.max(1, Math.min(4, Math.round(960 / data.size[0])));
  [screen.width, screen.height] = data.size.map((side) => side * zoom);
  scrub.max = Math.max(0, data.keys.length - 1);
  let at = 0, timer = 0;

  // The centre of an image pixel is the centre of its block on the screen.
  const place = (v) => (v + 0.5) * zoom;

  function corner(p, i) {
    const [x, y] = [p[2 * i], p[2 * i + 1]];
    const toward = (j) => [x + 0.2 * (p[2 * j] - x), y + 0.2 * (p[2 * j + 1] - y)];
    const [a, b] = [toward((i + 3) % 4), toward((i + 1) % 4)];
    pen.moveTo(place(a[0]), place(a[1]));
    pen.lineTo(place(x), place(y));
    pen.lineTo(place(b[0]), place(b[1]));
  }

  function body(target) {
    const p = target.at;
    pen.strokeStyle = pen.fillStyle = target.colour;
    pen.lineWidth = 2;
    pen.beginPath();
    if (target.guess) {
      for (let i = 0; i < 4; i++) corner(p, i);
    } else {
      for (let i = 0; i < 4; i++) pen[i ? "lineTo" : "moveTo"](place(p[2 * i]), place(p[2 * i + 1]));
      pen.closePath();
    }
    const [x, y] = [place(p[8]), place(p[9])];
    pen.moveTo(x - 5, y);
    pen.lineTo(x + 5, y);
    pen.moveTo(x, y - 5);
    pen.lineTo(x, y + 5);
    pen.stroke();
    const top = place(Math.min(p[1], p[3], p[5], p[7])), left = place(Math.min(p[0], p[2], p[4], p[6]));
    pen.font = "600 13px system-ui, sans-serif";
    const wide = pen.measureText(target.name).width + 8;
    const [lx, ly] = [Math.max(0, Math.min(left, screen.width - wide)), top > 22 ? top - 20 : top + 4];
    pen.fillStyle = "rgb(0 0 0 / .6)";
    pen.fillRect(lx, ly, wide, 17);
    pen.fillStyle = target.colour;
    pen.fillText(target.name, lx + 4, ly + 13);
  }

  function show(index) {
    at = Math.max(0, Math.min(index, data.keys.length - 1));
    const key = data.keys[at];
    if (!key) return;
    scrub.value = at;
    clock.textContent = `frame ${key.frame}, ${key.targets.length} targets`;
    const picture = new Image();
    picture.onload = () => {
      if (data.keys[at] !== key) return;
      pen.imageSmoothingEnabled = false;
      pen.drawImage(picture, 0, 0, screen.width, screen.height);
      key.targets.forEach(body);
    };
    picture.src = `data:image/jpeg;base64,${key.jpeg}`;
  }

  function toggle() {
    if (timer) {
      timer = clearInterval(timer);
    } else {
      if (at + 1 >= data.keys.length) at = -1;
      timer = setInterval(() => (at + 1 < data.keys.length ? show(at + 1) : toggle()), (1000 * data.every) / (data.rate || 30));
    }
    play.textContent = timer ? "❚❚" : "▶";
  }

  scrub.addEventListener("input", () => show(Number(scrub.value)));
  play.addEventListener("click", toggle);
  document.addEventListener("keydown", (event) => {
    if (event.target.closest("input, button, summary")) return;
    if (event.key === " ") toggle();
    else if (event.key === "ArrowRight") show(at + 1);
    else if (event.key === "ArrowLeft") show(at - 1);
    else return;
    event.preventDefault();
  });
  const wanted = Number(location.hash.slice(1));
  const first = data.keys.findIndex((key) => key.frame >= wanted);
  show(wanted > 0 && first >= 0 ? first : 0);
})();

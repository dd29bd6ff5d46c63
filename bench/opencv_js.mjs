// Compares the JavaScript package with what OpenCV.js offers for tracking: speed, mean IoU and compressed size, in node, one thread.
//   npm install ./foveate-0.1.0.tgz @techstark/opencv-js@5.0.0-release.1       # anywhere; web/build and npm/pack make the first
//   node bench/opencv_js.mjs FOLDER data/tracking [SEQUENCE...]                     # FOLDER has node_modules
// All read the same RGBA frames, which ffmpeg decodes before, and get the true box of frame 1. The time includes the copy into the
// WebAssembly and the conversion of colours; it is CPU time. CamShift follows the histogram of hue, matchTemplate the patch of frame 1.
import { execFileSync } from 'node:child_process';
import { existsSync, readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { dirname, join, resolve } from 'node:path';
import { pathToFileURL } from 'node:url';
import { gzipSync } from 'node:zlib';

const FRAMES = 150;
const [modules, data, ...given] = process.argv.slice(2);
if (!data) {
  console.error('usage: node bench/opencv_js.mjs FOLDER FOLDER-OF-SEQUENCES [SEQUENCE...]');
  process.exit(2);
}
const names = given.length ? given : ['Car1', 'Couple', 'Crossing', 'Dog1', 'DragonBaby'];
const require = createRequire(resolve(modules, 'x'));
const { Tracker } = await import(pathToFileURL(require.resolve('foveate')));
const opencv = require.resolve('@techstark/opencv-js'), cv = await require(opencv);
if (!cv.Mat) await new Promise(done => cv.onRuntimeInitialized = done);

function read(name) {
  const folder = join(data, name), files = join(folder, 'img', '*.jpg');
  const ask = ['-v', 'error', '-select_streams', 'v', '-show_entries', 'stream=width,height', '-of', 'csv=p=0', '-pattern_type', 'glob', files];
  const [width, height] = String(execFileSync('ffprobe', ask)).trim().split(',').map(Number);
  const make = ['-v', 'error', '-pattern_type', 'glob', '-i', files, '-frames:v', FRAMES, '-pix_fmt', 'rgba', '-f', 'rawvideo', '-'];
  const bytes = execFileSync('ffmpeg', make, { maxBuffer: 2 ** 31 }), size = 4 * width * height;
  const pictures = Array.from({ length: bytes.length / size }, (_, t) => ({ width, height, data: bytes.subarray(t * size, (t + 1) * size) }));
  const file = ['groundtruth_rect.txt', 'groundtruth_rect.1.txt'].map(name => join(folder, name)).find(existsSync);
  const truth = readFileSync(file, 'utf8').trim().split('\n').map(line => line.trim().split(/[\s,]+/).map(Number));
  return { pictures, truth: truth.map(([x, y, width, height]) => ({ x: x - 1, y: y - 1, width, height })) };
}

function iou(a, b) {
  const side = (p, n) => Math.max(0, Math.min(a[p] + a[n], b[p] + b[n]) - Math.max(a[p], b[p]));
  const both = side('x', 'width') * side('y', 'height');
  return both / (a.width * a.height + b.width * b.height - both);
}

const foveate = configuration => async (picture, box) => {
  const tracker = await Tracker.create(configuration);
  tracker.init(picture, box);
  return { update: picture => tracker.update(picture).box, free: () => tracker.free() };
};

// A tracker of OpenCV.js: `start` gets the first picture and box, and returns a function from a picture to a box.
const of = (colours, start) => async ({ width, height, data }, { x, y, width: w, height: h }) => {
  const rgba = new cv.Mat(height, width, cv.CV_8UC4), picture = new cv.Mat();
  const show = data => { rgba.data.set(data); cv.cvtColor(rgba, picture, colours); return picture; };
  const left = Math.max(0, Math.round(x)), top = Math.max(0, Math.round(y));
  const box = new cv.Rect(left, top, Math.min(Math.round(w), width - left), Math.min(Math.round(h), height - top));
  const next = start(show(data), box);
  return { update: ({ data }) => next(show(data)), free: () => [rgba, picture].forEach(it => it.delete()) };
};

const mil = of(cv.COLOR_RGBA2RGB, (picture, box) => {
  const tracker = new cv.TrackerMIL();
  tracker.init(picture, box);
  return picture => { [, box] = tracker.update(picture); return box; };
});

const camShift = of(cv.COLOR_RGBA2RGB, (picture, box) => {
  const hsv = new cv.Mat(), mask = new cv.Mat(), histogram = new cv.Mat(), likely = new cv.Mat(), images = new cv.MatVector();
  const stop = new cv.TermCriteria(cv.TermCriteria_EPS | cv.TermCriteria_COUNT, 10, 1);
  const hue = () => { cv.cvtColor(picture, hsv, cv.COLOR_RGB2HSV); return hsv; };
  const patch = hue().roi(box), patches = new cv.MatVector();
  const limits = [[0, 30, 32, 0], [180, 255, 255, 0]].map(it => new cv.Mat(patch.rows, patch.cols, patch.type(), it));
  cv.inRange(patch, ...limits, mask);
  patches.push_back(patch);
  cv.calcHist(patches, [0], mask, histogram, [180], [0, 180]);
  cv.normalize(histogram, histogram, 0, 255, cv.NORM_MINMAX);
  images.push_back(hsv);
  return () => {
    hue();
    cv.calcBackProject(images, [0], histogram, likely, [0, 180], 1);
    [, box] = cv.CamShift(likely, box, stop);
    return box;
  };
});

const template = of(cv.COLOR_RGBA2GRAY, (picture, box) => {
  const patch = new cv.Mat(), score = new cv.Mat();
  picture.roi(box).copyTo(patch);
  return picture => {
    const [left, top] = [box.x - box.width, box.y - box.height].map(side => Math.max(0, side));
    const right = Math.min(picture.cols, box.x + 2 * box.width), bottom = Math.min(picture.rows, box.y + 2 * box.height);
    const near = picture.roi(new cv.Rect(left, top, right - left, bottom - top));
    cv.matchTemplate(near, patch, score, cv.TM_CCOEFF_NORMED);
    near.delete();
    const { x, y } = cv.minMaxLoc(score).maxLoc;
    return box = new cv.Rect(left + x, top + y, box.width, box.height);
  };
});

const sequences = names.map(read);
const ours = { 'foveate, balanced': foveate('balanced'), 'foveate, fast': foveate('fast') };
const trackers = { ...ours, TrackerMIL: mil, CamShift: camShift, matchTemplate: template };
for (const [name, start] of Object.entries(trackers)) {
  let seconds = 0, frames = 0, overlap = [];
  for (const { pictures, truth } of sequences) {
    const tracker = await start(pictures[0], truth[0]);
    const boxes = pictures.slice(1).map(picture => {
      const before = process.cpuUsage(), box = tracker.update(picture), { user, system } = process.cpuUsage(before);
      seconds += (user + system) / 1e6;
      return box;
    });
    tracker.free();
    frames += boxes.length;
    overlap.push(boxes.reduce((sum, box, t) => sum + iou(box, truth[t + 1]), 0) / boxes.length);
  }
  const mean = overlap.reduce((a, b) => a + b) / overlap.length;
  console.log(`${name}: ${(frames / seconds).toFixed(0)} frames/s, mean IoU ${mean.toFixed(2)} (${overlap.map(v => v.toFixed(2)).join(' ')})`);
}
const packed = files => files.reduce((sum, file) => sum + gzipSync(readFileSync(file), { level: 9 }).length, 0);
const folder = dirname(require.resolve('foveate'));
const parts = ['index.js', 'binding.js', 'foveate.wasm'].map(file => join(folder, file));
console.log(`gzip, kB: foveate ${packed(parts) / 1000}, opencv.js ${packed([opencv]) / 1000}`);
process.exit(0);

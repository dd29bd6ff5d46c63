// Uses the package in node and in a browser. `api` and `threads` are its two modules.

// The same texts have the same bits: JSON gives every number back exactly.
const same = (name, a, b) => { if (JSON.stringify(a) !== JSON.stringify(b)) throw new Error(`${name} differs`); };
const box = ([x, y, width, height]) => ({ x, y, width, height });

// Results of one target and of many on frames of RGBA. Half-way the state is saved, and another tracker continues from it; the
// trackers in threads get the same results.
export async function follow({ Tracker, MultiTracker }, { WorkerTracker, WorkerMultiTracker }, bytes, { width, height, count, boxes, one, many }) {
  const size = 4 * width * height, half = count >> 1;
  const picture = t => ({ width, height, data: bytes.subarray(t * size, (t + 1) * size) });
  const found = t => boxes.map(([x, y, w, h]) => ({ ...box([x + t, y, w, h]), score: 0.9 }));
  const next = {
    one: async (tracker, t) => t ? [await tracker.update(picture(t))] : (await tracker.init(picture(0), box(boxes[0])), []),
    many: async (tracker, t) => {
      const results = await tracker.update(picture(t), t ? found(t) : []);
      if (!t) for (const given of boxes) await tracker.add(picture(0), box(given));
      return results;
    },
  };
  const kinds = [['one', one, Tracker, WorkerTracker], ['many', many, MultiTracker, WorkerMultiTracker]], all = {};
  for (const [kind, configuration, Here, There] of kinds) {
    const tracker = await Here.create(configuration), second = await Here.create(configuration), thread = await There.create(configuration);
    const results = [], continued = [];
    for (let t = 0; t < count; t++) {
      results.push(await next[kind](tracker, t));
      same(`${kind}, frame ${t}, in a thread`, await next[kind](thread, t), results[t]);
      if (t === half) {
        second.load(tracker.save());
        second.skip(picture(t));
      }
      if (t > half) continued.push(await next[kind](second, t));
    }
    same(`${kind}, continued`, continued, results.slice(half + 1));
    for (const each of [tracker, second, thread]) each.free();
    all[kind] = results;
  }
  return all;
}

// The codes and texts that misuse gives, by name.
export async function misuse({ Tracker, MultiTracker, FoveateError }, { WorkerTracker }) {
  const picture = (width, height, bytes = 4 * width * height) => ({ width, height, data: new Uint8ClampedArray(bytes).fill(9) });
  const good = box([8, 8, 16, 16]), codes = {};
  const attempt = async (name, act) => {
    try { await act(); codes[name] = 'none'; } catch (error) {
      codes[name] = error instanceof FoveateError ? error.code : String(error);
      if (!(error.message.length > 20)) codes[name] = `no text: ${error.message}`;
    }
  };
  await attempt('configuration', () => Tracker.create('no such'));
  await attempt('configuration that is a number', () => Tracker.create(7));
  await attempt('seed', () => Tracker.create('fast', { seed: 0.5 }));
  await attempt('state of nothing', async () => (await Tracker.create('fast')).load('{}'));
  const tracker = await Tracker.create('fast'), many = await MultiTracker.create('multi-boxes'), thread = await WorkerTracker.create('fast');
  await attempt('update before init', () => tracker.update(picture(64, 48)));
  await attempt('update before init in a thread', () => thread.update(picture(64, 48)));
  await attempt('box of NaN', () => tracker.init(picture(64, 48), { ...good, width: NaN }));
  await attempt('box of NaN in a thread', () => thread.init(picture(64, 48), { ...good, width: NaN }));
  await attempt('box without a height', () => tracker.init(picture(64, 48), { x: 1, y: 1, width: 4 }));
  await attempt('box outside', () => tracker.init(picture(64, 48), box([900, 8, 16, 16])));
  await attempt('no picture', () => tracker.init(null, good));
  await attempt('picture of text', () => tracker.init({ width: 2, height: 2, data: 'text' }, good));
  await attempt('picture without a side', () => tracker.init(picture(0, 48), good));
  await attempt('picture with too few bytes', () => tracker.init(picture(64, 48, 64 * 48 * 4 - 1), good));
  await attempt('picture of gigabytes', () => tracker.init({ ...picture(1, 1), width: 65535, height: 65535 }, good));
  tracker.init(picture(64, 48), good);
  await attempt('time of NaN', () => tracker.setTime(NaN));
  await attempt('another size', () => tracker.update(picture(48, 64)));
  await attempt('state of many', () => tracker.load(many.save()));
  tracker.init(picture(64, 48), good);
  if (!(tracker.update(picture(64, 48)).pLost <= 1)) codes['after errors'] = 'no result';
  await attempt('detection of NaN', () => many.update(picture(64, 48), [{ ...good, x: NaN }]));
  await attempt('detection without a width', () => many.update(picture(64, 48), [box([1, 1, 0, 4])]));
  for (const each of [tracker, many, thread]) each.free();
  tracker.free();
  await attempt('after free', () => tracker.update(picture(64, 48)));
  await attempt('after free in a thread', () => thread.update(picture(64, 48)));
  return codes;
}

// Follows targets through pictures. Each tracker has an instance of the WebAssembly, and so a memory of its own, which `free` releases.
import { load } from './binding.js';

/** A call that failed. `code` is "invalid", "config", "memory", "freed" or "internal". */
export class FoveateError extends Error {
  constructor(code, message) {
    super(message);
    this.name = 'FoveateError';
    this.code = code;
  }
}

const invalid = text => new FoveateError('invalid', text);
const fetched = async () => {
  const response = await fetch(new URL('./foveate.wasm', import.meta.url));
  if (!response.ok) throw new FoveateError('internal', `foveate.wasm: the server answers ${response.status}; serve it beside the scripts, or call useWasm`);
  return response.arrayBuffer();
};
let read = fetched, module = null;

/** Sets where the WebAssembly comes from, before the first tracker: a function that returns its bytes. */
export function useWasm(source) {
  read = source;
  module = null;
}

const compiled = () => module ??= (async () => WebAssembly.compile(await read()))().catch(error => { module = null; throw error; });

const bytesOf = data => data instanceof Uint8Array ? data
  : data instanceof Uint8ClampedArray ? new Uint8Array(data.buffer, data.byteOffset, data.byteLength) : null;

function pictureOf(picture) {
  const bytes = bytesOf(picture?.data), size = [picture?.width, picture?.height];
  if (!bytes) throw invalid('the picture: expected ImageData, or an object with width, height and data of bytes (Uint8Array)');
  if (!size.every(side => Number.isInteger(side) && side > 0 && side < 2 ** 16)) {
    throw invalid(`the picture is ${size.join(' x ')}; give whole numbers of pixels, 1 to 65535`);
  }
  return { size, bytes };
}

function boxOf(box, name) {
  const sides = ['x', 'y', 'width', 'height'], numbers = sides.map(side => box?.[side]);
  const wrong = sides.find((side, i) => typeof numbers[i] !== 'number' || !Number.isFinite(numbers[i]));
  if (wrong) throw invalid(`${name}: ${wrong} is ${box?.[wrong]}; give x, y (left, top), width and height as finite numbers of pixels`);
  return numbers;
}

function whole(number, name) {
  if (!Number.isSafeInteger(number) || number < 0) throw invalid(`${name} is ${number}; give a whole number of 0 or more`);
  return number;
}

const NOTHING = new Uint8Array(0), NEW = Symbol('new');

class Base {
  #wasm;
  constructor(key, wasm) {
    if (key !== NEW) throw new TypeError('create a tracker by: await Tracker.create(configuration)');
    this.#wasm = wasm;
  }
  static async create(configuration = this.usual, { seed = null } = {}) {
    if (typeof configuration !== 'string') throw invalid('the configuration: expected a name or TOML as text');
    if (seed !== null) whole(seed, 'the seed');
    const tracker = new this(NEW, await load(await compiled()));
    tracker.call({ op: 'create', many: this.many, config: configuration, seed }, NOTHING);
    return tracker;
  }
  call(message, bytes) {
    if (!this.#wasm) throw new FoveateError('freed', 'this tracker was freed; create another one');
    let answer;
    try { answer = this.#wasm.call(message, bytes); } catch (error) {
      this.#wasm = null; // Its memory may be damaged.
      throw new FoveateError('internal', `a fault inside foveate: ${error.message}; this tracker is freed`);
    }
    if (answer.error) throw new FoveateError(answer.code, answer.error);
    return answer;
  }
  show(message, picture) {
    const { size, bytes } = pictureOf(picture);
    return this.call({ ...message, picture: size }, bytes);
  }
  skip(picture) { this.show({ op: 'skip' }, picture); }
  save() { return this.call({ op: 'save' }, NOTHING).state; }
  load(state) {
    if (typeof state !== 'string') throw invalid('the state: expected the text that save returned');
    this.call({ op: 'load' }, new TextEncoder().encode(state));
  }
  free() { this.#wasm = null; }
}

export class Tracker extends Base {
  static many = false;
  static usual = 'balanced';
  init(picture, box) { this.show({ op: 'init', box: boxOf(box, 'the box') }, picture); }
  update(picture) { return this.show({ op: 'update', detections: [] }, picture).result; }
  setTime(seconds) {
    if (!Number.isFinite(seconds)) throw invalid(`the time is ${seconds}; give a finite number of seconds`);
    this.call({ op: 'set_time', seconds }, NOTHING);
  }
  resetAt(box) { this.call({ op: 'reset_at', box: boxOf(box, 'the box') }, NOTHING); }
}

export class MultiTracker extends Base {
  static many = true;
  static usual = 'multi';
  update(picture, detections = []) {
    const given = Array.from(detections, (detection, i) => {
      const score = detection.score ?? null;
      if (score !== null && typeof score !== 'number') throw invalid(`detection ${i}: score is ${score}; give a number, or leave it out`);
      return [boxOf(detection, `detection ${i}`), score];
    });
    return this.show({ op: 'update', detections: given }, picture).results;
  }
  add(picture, box, id = null) {
    return this.show({ op: 'add', box: boxOf(box, 'the box'), id: id === null ? null : whole(id, 'the id') }, picture).id;
  }
  remove(id) { return this.call({ op: 'remove', id: whole(id, 'the id') }, NOTHING).removed; }
}

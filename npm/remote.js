// Trackers in threads of their own: the functions of index.js, each returning a promise. Pictures are copied to the thread.
import { FoveateError } from './index.js';

// What a thread can be given: of a picture its bytes, wherever it has them; of a generator its values.
const plain = value => {
  if (value === null || typeof value !== 'object' || ArrayBuffer.isView(value) || value instanceof ArrayBuffer) return value;
  if (Symbol.iterator in value) return Array.from(value);
  return value.data && value.width ? { width: value.width, height: value.height, data: value.data } : value;
};

// `start(heard, broken)` starts a thread and returns { post, end }.
const make = (start, kind, names) => class {
  #thread; #waiting = new Map(); #calls = 0; #ended = null;
  constructor() {
    this.#thread = start(({ call, value, failed }) => {
      const waiting = this.#waiting.get(call);
      this.#waiting.delete(call);
      if (failed) waiting?.no(new FoveateError(failed.code, failed.message));
      else waiting?.yes(value);
    }, why => this.#end(new FoveateError('internal', `the thread of this tracker ended: ${why}; create another one`)));
  }
  static async create(...values) {
    const tracker = new this();
    try { await tracker.#ask('create', [kind, ...values]); } catch (error) { tracker.free(); throw error; }
    return tracker;
  }
  static {
    for (const name of names) this.prototype[name] = function (...values) { return this.#ask(name, values); };
  }
  #ask(name, values) {
    return new Promise((yes, no) => {
      if (this.#ended) throw this.#ended;
      const call = this.#calls++;
      this.#thread.post({ call, name, values: values.map(plain) });
      this.#waiting.set(call, { yes, no });
    });
  }
  #end(error) {
    this.#ended ??= error;
    for (const { no } of this.#waiting.values()) no(error);
    this.#waiting.clear();
    this.#thread.end();
  }
  free() { this.#end(new FoveateError('freed', 'this tracker was freed; create another one')); }
};

const BOTH = ['update', 'skip', 'save', 'load'];
export const remote = start => ({
  WorkerTracker: make(start, 'Tracker', [...BOTH, 'init', 'setTime', 'resetAt']),
  WorkerMultiTracker: make(start, 'MultiTracker', [...BOTH, 'add', 'remove']),
});

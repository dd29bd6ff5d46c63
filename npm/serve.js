// The thread's side of remote.js: one tracker, and the answers to its calls.
import { MultiTracker, Tracker } from './index.js';

const kinds = { Tracker, MultiTracker };
let tracker = null;

export async function serve({ call, name, values }, post) {
  try {
    if (name === 'create') {
      const [kind, ...rest] = values;
      tracker = await kinds[kind].create(...rest);
      return post({ call });
    }
    post({ call, value: tracker[name](...values) });
  } catch (error) {
    post({ call, failed: { code: error.code ?? 'internal', message: error.message } });
  }
}

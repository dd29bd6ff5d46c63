import { Worker } from 'node:worker_threads';
import { remote } from './remote.js';

export { FoveateError } from './index.js';
export const { WorkerTracker, WorkerMultiTracker } = remote((heard, broken) => {
  const thread = new Worker(new URL('./thread-node.js', import.meta.url));
  thread.on('message', heard);
  thread.on('error', error => broken(error.message));
  return { post: message => thread.postMessage(message), end: () => thread.terminate() };
});

import { remote } from './remote.js';

export { FoveateError } from './index.js';
export const { WorkerTracker, WorkerMultiTracker } = remote((heard, broken) => {
  const thread = new Worker(new URL('./thread.js', import.meta.url), { type: 'module' });
  thread.onmessage = ({ data }) => heard(data);
  thread.onerror = event => broken(event.message ?? 'it did not start');
  return { post: message => thread.postMessage(message), end: () => thread.terminate() };
});

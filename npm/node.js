// In node: the WebAssembly is read from the file beside this one.
import { readFile } from 'node:fs/promises';
import { useWasm } from './index.js';

useWasm(() => readFile(new URL('./foveate.wasm', import.meta.url)));
export * from './index.js';

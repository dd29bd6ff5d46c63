import { parentPort } from 'node:worker_threads';
import './node.js';
import { serve } from './serve.js';

parentPort.on('message', data => serve(data, message => parentPort.postMessage(message)));

// node check.mjs PACKAGE FRAMES SCENE: prints the results of check.js as JSON. PACKAGE is a folder that `npm install` would make;
// without FRAMES the codes of misuse.
import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { pathToFileURL } from 'node:url';
import { follow, misuse } from './check.js';

const [folder, frames, scene] = process.argv.slice(2);
const module = name => import(pathToFileURL(createRequire(`${folder}/`).resolve(name)));
const [api, threads] = [await module('foveate'), await module('foveate/worker')];
console.log(JSON.stringify(frames ? await follow(api, threads, readFileSync(frames), JSON.parse(scene)) : await misuse(api, threads)));

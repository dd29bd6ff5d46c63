import type { Box, Detection, Options, Picture, Result } from './index.js';

export { FoveateError } from './index.js';

declare class Base {
  protected constructor();
  skip(picture: Picture): Promise<void>;
  save(): Promise<string>;
  load(state: string): Promise<void>;
  /** Ends the thread. Calls that wait fail. */
  free(): void;
}

/** `Tracker` in a thread of its own. Pictures are copied to it. */
export class WorkerTracker extends Base {
  static create(configuration?: string, options?: Options): Promise<WorkerTracker>;
  init(picture: Picture, box: Box): Promise<void>;
  update(picture: Picture): Promise<Result>;
  setTime(seconds: number): Promise<void>;
  resetAt(box: Box): Promise<void>;
}

/** `MultiTracker` in a thread of its own. Pictures are copied to it. */
export class WorkerMultiTracker extends Base {
  static create(configuration?: string, options?: Options): Promise<WorkerMultiTracker>;
  update(picture: Picture, detections?: Iterable<Detection>): Promise<Result[]>;
  add(picture: Picture, box: Box, id?: number | null): Promise<number>;
  remove(id: number): Promise<boolean>;
}

/** A picture: `ImageData`, or bytes row by row without gaps. */
export interface Picture {
  /** Pixels. */
  readonly width: number;
  /** Pixels. */
  readonly height: number;
  /** For each pixel 1 byte (grey), 3 (red, green, blue), or 4 (and one that is not read). */
  readonly data: Uint8Array | Uint8ClampedArray;
}

/** An upright box in pixels, as `DOMRect`: left, top, width, height. The top-left pixel covers 0 to 1. */
export interface Box {
  readonly x: number;
  readonly y: number;
  readonly width: number;
  readonly height: number;
}

/** A box that your detector found. A larger score is surer. */
export interface Detection extends Box {
  readonly score?: number | null;
}

export type Status = 'tracking' | 'occluded' | 'lost' | 'reacquired';

/** A target in one picture. */
export interface Result {
  /** The number of the target, from 1. */
  id: number;
  /** The estimated box. */
  box: { x: number; y: number; width: number; height: number };
  status: Status;
  /** Whether the status is tracking or reacquired. Otherwise the box is a guess. */
  usable: boolean;
  /** The probability, 0 to 1, that the box has an IoU below 0.1 with the target or that the target is not visible. */
  pLost: number;
  /** 7 x 7: centre x, y, their velocities (pixels a frame), log scale, angle (radians), log aspect. */
  covariance: number[][];
  /** The index of the detection that was assigned to the target in this picture; null if there is none. */
  detection: number | null;
}

export interface Options {
  /** The seed of all random numbers, a whole number; by default that of the configuration. */
  seed?: number | null;
}

/**
 * A call that failed. Unless `load` failed, the tracker has not changed.
 * `code`: "invalid" (an argument), "config", "memory" (the picture is too large), "freed" (after `free`), "internal".
 */
export class FoveateError extends Error {
  readonly code: 'invalid' | 'config' | 'memory' | 'freed' | 'internal';
}

/** Sets where the WebAssembly comes from, before the first tracker. By default it lies beside the scripts. */
export function useWasm(source: () => BufferSource | Promise<BufferSource>): void;

declare class Base {
  protected constructor();
  /** Observes a picture without tracking: one before the first, or the last one before `load`. */
  skip(picture: Picture): void;
  /** Returns the whole state as text. */
  save(): string;
  /** Restores a state in a tracker of the same configuration and seed. To continue bit for bit, call `skip` with the last picture before. */
  load(state: string): void;
  /** Releases the memory. Every later call but `free` fails. */
  free(): void;
}

/** Follows one target. */
export class Tracker extends Base {
  /** `configuration`: "fast", "balanced" (the default), "accurate", the name of a configuration that ships, or TOML. */
  static create(configuration?: string, options?: Options): Promise<Tracker>;
  /** Starts, or restarts, on the target in this box of a picture. */
  init(picture: Picture, box: Box): void;
  /** Tracks the target into the next picture, which has the size and the colours of the first one. */
  update(picture: Picture): Result;
  /**
   * Sets the time of the next picture, seconds from any origin. If frames were dropped before it, the particles move for as many frames
   * more, 30 at most; at a constant rate nothing changes.
   */
  setTime(seconds: number): void;
  /** Moves the target into this box, and keeps the learned appearance. */
  resetAt(box: Box): void;
}

/** Follows many targets: those that you add, and those that detections start. */
export class MultiTracker extends Base {
  /** `configuration`: "multi" (the default), "multi-boxes", the name of another configuration for many targets, or TOML. */
  static create(configuration?: string, options?: Options): Promise<MultiTracker>;
  /** Tracks all targets into the next picture. Returns the active ones by id; those that are not `usable` are guesses. */
  update(picture: Picture, detections?: Iterable<Detection>): Result[];
  /** Adds a target in the picture of the last update, or restarts one. Returns its id. */
  add(picture: Picture, box: Box, id?: number | null): number;
  /** Ends the track of a target permanently. Returns whether it was active. */
  remove(id: number): boolean;
}

#!/usr/bin/env python3
"""A simulated pan-tilt head, steered by the track: prediction and uncertainty beside the centre of the box.

    bench/ptz.py data/tracking data/tracking-wide

The view is a window of VIEW of the sides of the picture; the head moves it by at most SPEED of the picture's width a frame, and a command
shows --delay frames after the picture that it comes from. The tracker sees the window alone. Ten sequences: those whose target travels
farthest, relative to the picture, and fits the window. It prints the share of frames whose true centre is in view, and the median
distance of the target from the middle of the view, in sides of the view.

`centre` steers to the reported box. `predicted` steers to where the target will be after the delay: a Kalman filter over the ground, with the
reported covariance and P(lost) as its noise, and the commands on their way. Both with two gains.
"""

import argparse
from pathlib import Path

import foveate
import numpy as np
from annotate import sequences

VIEW, SPEED, SEQUENCES, FRAMES = 0.25, 0.03, 10, 400
GAINS = [0.3, 0.6]


def pictures(folder):
    """The pictures of a sequence, RGB."""
    return [np.array(picture) for picture, _ in zip(foveate.Video(folder / "img"), range(FRAMES))]


def follow(images, truth, control, tracker, delay):
    """Share of frames in view, and distances from the middle in sides of the view."""
    height, width = images[0].shape[:2]
    view = np.array([int(VIEW * width), int(VIEW * height)])
    limit, most = SPEED * width, np.array([width, height]) - view
    middle = truth[:, :2] + truth[:, 2:] / 2
    head = np.clip(middle[0] - view / 2, 0, most)
    queue = [np.zeros(2)] * (delay - 1)
    inside, far = [], []
    for t, image in enumerate(images):
        left, top = np.round(head).astype(int)
        part = np.ascontiguousarray(image[top : top + view[1], left : left + view[0]])
        corner = np.array([left, top])
        if t == 0:
            tracker.init(part, (*(truth[0, :2] - corner), *truth[0, 2:]))
            wanted = head + view / 2
        else:
            seen = tracker.update(part)
            wanted = control(seen, corner, view)
        if np.isfinite(middle[t, 0]):
            off = middle[t] - corner
            inside.append(bool(np.all((off >= 0) & (off < view))))
            far.append(float(np.hypot(*(off / view - 0.5))))
        queue.append(command(control, wanted, head + view / 2, queue, limit))
        head = np.clip(head + queue.pop(0), 0, most)
    return np.mean(inside), np.median(far)


def command(control, wanted, middle, queue, limit):
    """The motion of the head that shows after the delay."""
    step = control.gain * (wanted - middle - (sum(queue) if control.counts_queue else 0))
    return step * min(1, limit / max(np.hypot(*step), 1e-9))


class Centre:
    counts_queue = False

    def __init__(self, gain, delay):
        self.gain = gain

    def __call__(self, seen, corner, view):
        x, y, w, h = seen.box
        return corner + (x + w / 2, y + h / 2)


class Predicted:
    """A Kalman filter of constant velocity over the ground: the head's own motion is known, and is no motion of the target."""

    counts_queue = True
    ACCELERATION = 0.05  # of the box's side, a frame, standard deviation

    def __init__(self, gain, delay):
        self.gain, self.delay, self.mean = gain, delay, None

    def __call__(self, seen, corner, view):
        x, y, w, h = seen.box
        place = corner + (x + w / 2, y + h / 2)
        if self.mean is None:
            self.mean, self.covariance = np.array([place, (0, 0)]), np.diag([1.0, 0.01 * w * h])
        step, noise = np.array([[1.0, 1.0], [0.0, 1.0]]), self.ACCELERATION**2 * w * h
        self.mean = step @ self.mean
        self.covariance = step @ self.covariance @ step.T + noise * np.array([[0.25, 0.5], [0.5, 1.0]])
        # With P(lost), the target may be anywhere in the view.
        variance = np.trace(seen.covariance[:2, :2]) / 2 + seen.p_lost * min(view) ** 2 / 12
        gain = self.covariance[:, 0] / (self.covariance[0, 0] + variance)
        self.mean = self.mean + np.outer(gain, place - self.mean[0])
        self.covariance = self.covariance - np.outer(gain, self.covariance[0])
        return self.mean[0] + self.delay * self.mean[1]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="+")
    parser.add_argument("--delay", type=int, default=2, help="frames from a picture to the motion that it causes, 1 or more")
    parser.add_argument("--config", default="natural")
    parser.add_argument("--set", default=["dynamics.damping=1"], nargs="*")
    args = parser.parse_args()
    settings = {key: float(value) for key, value in (text.split("=") for text in args.set)}
    found = []
    for name, folder, truth in sequences(args.folders):
        first = next(iter(foveate.Video(Path(folder) / "img")))
        height, width = first.shape[:2]
        truth = truth[:FRAMES] - (1, 1, 0, 0)  # pixels from 0
        middle = (truth[:, :2] + truth[:, 2:] / 2) / (width, height)
        if np.nanmax(truth[:, 2] / width) < 0.7 * VIEW and np.nanmax(truth[:, 3] / height) < 0.7 * VIEW and "-" not in name:
            found.append((np.nanmax(np.nanmax(middle, 0) - np.nanmin(middle, 0)), name, Path(folder), truth))
    found = sorted(found, key=lambda it: -it[0])[:SEQUENCES]
    controls = [(f"{name}, {gain}", of, gain) for name, of in (("centre", Centre), ("predicted", Predicted)) for gain in GAINS]
    table = {}
    for _, name, folder, truth in found:
        images = pictures(folder)
        truth = truth[: len(images)]
        for key, control, gain in controls:
            tracker = foveate.Tracker(args.config, config=settings, seed=1)
            result = follow(images, truth, control(gain, args.delay), tracker, args.delay)
            table.setdefault(key, []).append(result)
            print(f"{name:16} {key:15} in view {result[0]:.3f}  off the middle {result[1]:.3f}", flush=True)
    print("\n| control | in view, mean | least | off the middle, median |")
    for key, results in table.items():
        share, far = np.array(results).T
        print(f"| {key} | {share.mean():.3f} | {share.min():.3f} | {far.mean():.3f} |")


if __name__ == "__main__":
    main()

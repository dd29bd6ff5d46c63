#!/usr/bin/env python3
"""Measures g in simulated films of free fall and pendulums: `foveate measure`, OpenCV's template matching and CSRT.

Usage:
  pip install opencv-contrib-python-headless numpy
  cargo build --release
  bench/measure.py --foveate target/release/foveate --films 200 --out measure-films

A film has a textured ball of 16 to 28 px before a textured wall, noise of 2 to 12 grey levels, an exposure of 0 to 0.9 of
a frame (motion blur) and 30 to 240 frames/s. The ends of a ruler of 240 px are clicked with an error of 0.5 px in each
coordinate. All trackers get the exact box in frame 1. Template matching (normalised correlation, search of 40 px, parabola
through the peak) and CSRT go through the same smoother and fits, by `foveate measure --track`. A ball falls by 1.2 m. A
pendulum swings by 8 degrees over 2.5 periods; g follows from its period, its true length and its amplitude.

Output: a table by scene and tracker; OUT/films.csv, one line per film and tracker. g: error of g in per cent; inside: the
95 % interval holds the true g; offset: the mean error of a film's positions, which changes no velocity, pixels; tracked and
smoothed: root mean square error of the position without it; band: share of frames in which the 95 % band of the smoothed
position holds the true one.
"""
import argparse
import csv
import json
import math
import os
import subprocess
import sys

import cv2
import numpy as np

G = 9.81


def texture(rng, shape, size, contrast):
    small = rng.normal(0, 1, (shape[0] // size + 2, shape[1] // size + 2)).astype(np.float32)
    return contrast * cv2.resize(small, (shape[1], shape[0]), interpolation=cv2.INTER_CUBIC)


class Film:
    """One film: its pictures, and the true centres in pixels."""

    def __init__(self, scene, seed):
        rng = np.random.default_rng([seed, scene == "pendulum"])
        self.scene, self.rate = scene, float(rng.choice([30, 60, 120, 240]))
        self.noise, self.exposure, radius = rng.uniform(2, 12), rng.uniform(0, 0.9), rng.uniform(8, 14)
        height, width = 300, 240
        if scene == "fall":
            # From rest, 1.2 m.
            self.pixels = rng.uniform(150, 190)
            start = np.array([rng.uniform(60, 180), 30.0])
            frames = int(math.sqrt(2 * 1.2 / G) * self.rate)
            across = rng.uniform(-0.2, 0.2)
            self.place = lambda t: start + self.pixels * np.array([across * t, 0.5 * G * t * t])
        else:
            self.pixels, self.length, swing = rng.uniform(500, 700), rng.uniform(0.2, 0.35), math.radians(8)
            self.factor = 1 + swing ** 2 / 16
            omega = math.sqrt(G / self.length) / self.factor
            frames = int(2.5 * 2 * math.pi / omega * self.rate)
            arm = self.pixels * self.length
            centre = np.array([width / 2, 260.0 - arm])

            def place(t):
                angle = swing * math.cos(omega * t)
                return centre + arm * np.array([math.sin(angle), math.cos(angle)])

            self.place = place
        wall = 110 + texture(rng, (height, width), 12, 18)
        patch = 170 + texture(rng, (64, 64), 5, 30)
        ys, xs = np.mgrid[0:height, 0:width].astype(np.float32)
        self.truth, self.pictures = [], []
        for k in range(frames):
            picture = wall.copy()
            shutter = max(1, int(8 * self.exposure) + 1)
            for s in range(shutter):
                # The time of a frame is the middle of its exposure.
                t = (k + self.exposure * ((s + 0.5) / shutter - 0.5)) / self.rate
                x, y = self.place(max(t, 0.0))
                near = np.s_[max(0, int(y) - 17):int(y) + 19, max(0, int(x) - 17):int(x) + 19]
                dx, dy = xs[near] - np.float32(x), ys[near] - np.float32(y)
                alpha = np.clip(radius + 0.5 - np.hypot(dx, dy), 0, 1)
                ball = cv2.remap(patch, dx + 31.5, dy + 31.5, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
                picture[near] += alpha * (ball - wall[near]) / shutter
            picture += rng.normal(0, self.noise, picture.shape)
            self.pictures.append(np.clip(picture.round(), 0, 255).astype(np.uint8))
            self.truth.append(self.place(k / self.rate))
        self.truth = np.array(self.truth)
        side = math.ceil(2 * radius)
        self.box = [*(self.truth[0] - (side - 1) / 2), side, side]
        ends = np.array([[20.0, 20.0], [20.0, 260.0]])
        self.ruler = (ends + rng.normal(0, 0.5, ends.shape), 240.0 / self.pixels)

    def options(self):
        (a, b), length = self.ruler
        points = ",".join(f"{v + 1:.4f}" for v in [*a, *b])
        fit = "parabola:y" if self.scene == "fall" else "sine:x"
        return ["--ruler", f"{points}={length:.6f}m", "--fps", f"{self.rate}", "--fit", fit, "--origin", "1,1"]


def template(film):
    x, y, w, h = film.box
    left, top = round(x), round(y)
    patch, offset = film.pictures[0][top:top + h, left:left + w], np.array([x - left, y - top])
    at, centres = np.array([left, top]), [film.truth[0]]
    for picture in film.pictures[1:]:
        l, t = (max(0, v - 40) for v in at)
        window = picture[t:t + h + 80, l:l + w + 80]
        scores = cv2.matchTemplate(window, patch, cv2.TM_CCOEFF_NORMED)
        _, _, _, (u, v) = cv2.minMaxLoc(scores)
        fine = []
        for line, k in ((scores[v], u), (scores[:, u], v)):
            if 0 < k < len(line) - 1:
                a, b, c = line[k - 1:k + 2]
                fine.append(0.5 * (a - c) / (a - 2 * b + c))
            else:
                fine.append(0.0)
        at = np.array([l + u, t + v])
        centres.append(at + np.array(fine) + offset + (np.array([w, h]) - 1) / 2)
    return centres


def csrt(film):
    tracker = cv2.TrackerCSRT_create()
    colour = [cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR) for picture in film.pictures]
    x, y, w, h = (round(v) for v in film.box)
    tracker.init(colour[0], (x, y, w, h))
    offset, box, centres = np.array([film.box[0] - x, film.box[1] - y]), (x, y, w, h), [film.truth[0]]
    for picture in colour[1:]:
        found, new = tracker.update(picture)
        box = new if found else box
        centres.append(np.array([box[0] + (box[2] - 1) / 2, box[1] + (box[3] - 1) / 2]) + offset)
    return centres


def measure(film, program, tracker, folder):
    """Runs one tracker, and returns a line of the table."""
    os.makedirs(folder, exist_ok=True)
    if tracker == "foveate":
        pictures = os.path.join(folder, "film")
        os.makedirs(pictures, exist_ok=True)
        for k, picture in enumerate(film.pictures):
            cv2.imwrite(os.path.join(pictures, f"{k:04}.png"), picture)
        init = ",".join(f"{v:.4f}" for v in [film.box[0] + 1, film.box[1] + 1, film.box[2], film.box[3]])
        what = [pictures, "--init", init, "--no-video", "--no-report", "--threads", "1"]
    else:
        track = os.path.join(folder, "track.csv")
        centres = template(film) if tracker == "template" else csrt(film)
        with open(track, "w") as file:
            file.write("frame,time,x,y,cov_x_x,cov_x_y,cov_y_y,p_lost,status,usable\n")
            for k, (x, y) in enumerate(centres):
                file.write(f"{k + 1},{k / film.rate},{x},{y},0.01,0,0.01,0,tracking,1\n")
        what = ["--track", track]
    out = os.path.join(folder, "out")
    command = [program, "measure", *what, *film.options(), "--out", out]
    done = subprocess.run(command, capture_output=True, text=True)
    line = {"scene": film.scene, "tracker": tracker, "rate": film.rate, "noise": film.noise, "exposure": film.exposure}
    if done.returncode:
        print(done.stderr, file=sys.stderr)
        return {**line, "g": math.nan, "inside": 0, "offset": math.nan, "tracked": math.nan,
                "smoothed": math.nan, "band": math.nan}
    with open(os.path.join(out, "fits.json")) as file:
        fits = json.load(file)["fits"]
    values = {value["name"]: value for value in fits[0]["values"]} if fits else {}
    if not values:
        g, interval = math.nan, (math.nan, math.nan)
    elif film.scene == "fall":
        g, interval = values["g"]["value"], values["g"]["interval"]
    else:
        of = lambda period: 4 * math.pi ** 2 * film.length * film.factor ** 2 / period ** 2
        g, interval = of(values["T"]["value"]), [of(t) for t in reversed(values["T"]["interval"])]
    with open(os.path.join(out, "measure.csv")) as file:
        rows = list(csv.DictReader(file))
    metres = film.ruler[1] / math.dist(*film.ruler[0])
    tracked, smoothed, errors = [], [], []
    for row in rows:
        truth = film.truth[int(row["frame"]) - 1] * [1, -1]
        for i, axis in enumerate("xy"):
            off = float(row[f"{axis} (m)"]) / metres - truth[i]
            smoothed.append(off)
            errors.append(float(row[f"sd_{axis} (m)"]) / metres)
            if row[f"tracked_{axis} (m)"]:
                tracked.append(float(row[f"tracked_{axis} (m)"]) / metres - truth[i])
    rms = lambda errors: float(np.sqrt(np.mean(np.square(errors))))
    tracked, smoothed, errors = (np.reshape(values, (-1, 2)) for values in (tracked, smoothed, errors))
    offset, motion = smoothed.mean(0), smoothed - smoothed.mean(0)
    return {**line, "g": 100 * (g / G - 1), "inside": int(interval[0] <= G <= interval[1]), "offset": rms(offset),
            "tracked": rms(tracked - tracked.mean(0)), "smoothed": rms(motion), "band": float(np.mean(abs(smoothed) < 1.96 * errors))}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--foveate", default="foveate", help="the program")
    parser.add_argument("--films", type=int, default=40, help="half of them free fall, half pendulums")
    parser.add_argument("--trackers", nargs="+", default=["foveate", "template", "csrt"])
    parser.add_argument("--out", default="measure-films")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    lines = []
    for k in range(args.films):
        film = Film(["fall", "pendulum"][k % 2], k // 2)
        for tracker in args.trackers:
            lines.append(measure(film, args.foveate, tracker, os.path.join(args.out, f"{film.scene}-{k // 2}-{tracker}")))
    with open(os.path.join(args.out, "films.csv"), "w", newline="") as file:
        table = csv.DictWriter(file, list(lines[0]))
        table.writeheader()
        table.writerows(lines)
    print("scene     tracker    films  |g| median  |g| <= 1 %  inside  offset, px  tracked, px  smoothed, px  band")
    for scene in ("fall", "pendulum"):
        for tracker in args.trackers:
            some = [line for line in lines if (line["scene"], line["tracker"]) == (scene, tracker)]
            if not some:
                continue
            of = lambda name: np.array([line[name] for line in some])
            print(f"{scene:9} {tracker:9} {len(some):6} {np.nanmedian(abs(of('g'))):9.2f} %"
                  f" {100 * np.mean(abs(of('g')) <= 1):9.0f} % {100 * np.mean(of('inside')):5.0f} %"
                  f" {np.nanmedian(of('offset')):10.3f} {np.nanmedian(of('tracked')):12.3f} {np.nanmedian(of('smoothed')):13.3f} {np.nanmean(of('band')):5.2f}")


if __name__ == "__main__":
    main()

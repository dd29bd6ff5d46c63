#!/usr/bin/env python3
"""Makes the pictures of docs/measure.md, docs/annotate.md and docs/live.md from simulated films.

Usage:
  pip install opencv-contrib-python-headless numpy pillow            # and Chromium and ffmpeg
  bench/pictures.py target/release/foveate --out docs
"""
import argparse
import os
import subprocess
import tempfile

import cv2
import numpy as np
from measure import Film, texture
from PIL import Image, ImageDraw

YELLOW = (255, 220, 60)


def page(file, size, out):
    subprocess.run(["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", f"--window-size={size[0]},{size[1]}",
                    f"--screenshot={out}", f"file://{os.path.abspath(file)}"], check=True, stderr=subprocess.DEVNULL)
    return Image.open(out).convert("RGB")


def write(pictures, folder):
    os.makedirs(folder)
    for k, picture in enumerate(pictures):
        cv2.imwrite(f"{folder}/{k:04}.png", picture)


def box(film, k):
    x, y = film.truth[k] - (film.box[2] - 1) / 2 + 1
    return f"{x:.1f},{y:.1f},{film.box[2]},{film.box[3]}"


def measured(program, out):
    """A falling ball: every 13th frame in one picture, and the page of results."""
    film = Film("fall", 3)
    write(film.pictures, "film")
    subprocess.run([program, "measure", "film", "--init", box(film, 0), *film.options(), "--out", "ball"], check=True)
    results = page("ball/measure.html", (820, 2600), "measure.png").crop((0, 100, 820, 800))
    some = np.stack(film.pictures[::13]).astype(float)
    farthest = np.argmax(abs(some - np.median(np.stack(film.pictures[::3]), 0)), 0)
    balls = np.take_along_axis(some, farthest[None], 0)[0].astype(np.uint8)
    balls = Image.fromarray(balls).convert("RGB").resize((480, 600), Image.BICUBIC)
    draw, (x, y, w, h) = ImageDraw.Draw(balls), (2 * np.array(film.box)).tolist()
    draw.rectangle([x, y, x + w, y + h], outline=YELLOW, width=3)
    draw.line([(40, 42), (40, 521)], fill=YELLOW, width=4)
    both = Image.new("RGB", (1320, 700), (243, 242, 238))
    both.paste(balls, (0, 50))
    both.paste(results, (500, 0))
    both.resize((1000, 530), Image.LANCZOS).save(f"{out}/measure.webp", quality=70, method=6)


def hidden(program, out):
    """A pendulum behind a post: the frames to check, and four frames of the film."""
    film = next(film for film in (Film("pendulum", seed) for seed in range(40)) if film.rate == 60)
    post = np.clip(90 + texture(np.random.default_rng(2), (len(film.pictures[0]), 22), 4, 25), 0, 255)
    for picture in film.pictures:
        picture[:, 112:134] = post
    write(film.pictures, "pendulum")
    last = len(film.pictures) - 1
    keys = [box(film, k) if k in (0, last) else "NaN,NaN,NaN,NaN" for k in range(last + 1)]
    with open("keys.txt", "w") as file:
        file.write("\n".join(keys) + "\n")
    subprocess.run([program, "annotate", "pendulum", "--keyframes", "keys.txt", "--format", "otb", "--out", "boxes"], check=True)
    page("boxes/check.html", (820, 1100), "check.png").crop((0, 0, 820, 705)).save(f"{out}/annotate.webp", quality=70, method=6)
    subprocess.run([program, "track", "pendulum", "--init", keys[0], "--out", "track"], check=True)
    frames = "+".join(f"eq(n,{n})" for n in (15, 21, 24, 28))
    subprocess.run(["ffmpeg", "-v", "error", "-i", "track/annotated.mp4", "-vf", f"select='{frames}',tile=4x1", "-frames:v", "1", "strip.png"], check=True)
    strip = Image.open("strip.png").convert("RGB")
    strip.resize((strip.width // 2, strip.height // 2), Image.LANCZOS).save(f"{out}/occluded.webp", quality=65, method=6)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("--out", default="docs")
    args = parser.parse_args()
    program, out, before = os.path.abspath(args.program), os.path.abspath(args.out), os.getcwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        measured(program, out)
        hidden(program, out)
        os.chdir(before)


if __name__ == "__main__":
    main()

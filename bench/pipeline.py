#!/usr/bin/env python3
"""Time of whole runs on a video file: decoding, tracking, report and film, beside ffmpeg that decodes and discards.

  bench/pipeline.py PROGRAM VIDEO X,Y,W,H [--config natural] [--rounds 3]

Prints a row for each combination: frames a second, milliseconds of processor time a frame (with those of ffmpeg as a child), and their ratio
to ffmpeg alone, timed just before. Medians over rounds. A video of 1920 x 1080 from one of the clips:

  ffmpeg -i data/clips/hockey.mp4 -vf scale=1920:1080,noise=alls=8:allf=t -an -c:v libx264 -preset veryfast -crf 25 hockey1080.mp4
"""
import argparse, os, resource, statistics, subprocess, tempfile, time

RUNS = {
    "boxes, built-in decoder": ["--decoder", "builtin", "--no-video", "--no-report"],
    "boxes, ffmpeg": ["--decoder", "ffmpeg", "--no-video", "--no-report"],
    "boxes and report": ["--no-video"],
    "boxes and film": ["--no-report"],
    "boxes, report and film": [],
}


def timed(command):
    """Seconds by the clock and of processor time, children included."""
    used = lambda: sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])
    clock, processor = time.monotonic(), used()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.monotonic() - clock, used() - processor


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program")
    parser.add_argument("video")
    parser.add_argument("init")
    parser.add_argument("--config", default="natural")
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args()
    alone = ["ffmpeg", "-v", "error", "-i", args.video, "-f", "null", "-"]
    rows = {name: [] for name in ["ffmpeg alone", *RUNS]}
    with tempfile.TemporaryDirectory() as folder:
        out = os.path.join(folder, "out")
        track = [args.program, "track", args.video, "--init", args.init, "-c", args.config, "--out", out]
        for _ in range(args.rounds):
            for name, options in RUNS.items():
                peer = timed(alone)
                rows["ffmpeg alone"].append((*peer, 1.0))
                clock, processor = timed(track + options)
                rows[name].append((clock, processor, processor / peer[1]))
        with open(os.path.join(out, "boxes.txt"), encoding="utf-8") as boxes:
            frames = len(boxes.readlines())
    print(f"{frames} frames\n\n| run | frames/s | processor ms a frame | of ffmpeg |\n| --- | --- | --- | --- |")
    for name, times in rows.items():
        clock, processor, ratio = map(statistics.median, zip(*times))
        print(f"| {name} | {frames / clock:.0f} | {1e3 * processor / frames:.1f} | {ratio:.1f} |")


main()

#!/usr/bin/env python3
"""Runs other trackers (OpenCV's, dlib's, NanoTrack) on sequences in OTB layout, to compare them with `foveate eval --peers`.

Usage:
  pip install opencv-contrib-python-headless dlib
  bench/trackers.py --seqs data/tracking --out out-peers                 # all that are installed
  bench/trackers.py --seqs data/tracking --out out-peers --trackers csrt kcf
  bench/trackers.py --seqs data/tracking --out out-peers --trackers nano --nano backbone.onnx head.onnx
  foveate eval --seqs data/tracking --seeds 5 --peers out-peers

nano is NanoTrack V2, a pretrained Siamese network, run by OpenCV (cv2.TrackerNano). Its two files, a backbone and a head,
are no part of this repository: https://github.com/HonglinChu/SiamTrackers, NanoTrack/models/nanotrackv2. Without --nano it
is left out.

A sequence is a folder with img/ and groundtruth_rect.txt; groundtruth_rect.2.txt is a second target, NAME-2. A tracker
gets the true box in frame 1 and nothing more; where it reports a failure, its last box is kept.

Output: OUT/TRACKER/NAME.txt, x,y,w,h per frame, counted from 1; and NAME_time.txt, CPU seconds per frame without the
reading of the image (the first frame: initialisation). Existing results are kept and not run again. A tracker that is not
installed is left out; so is a tracker on a sequence on which it raises an error. One thread.
"""
import argparse
import glob
import os
import re
import sys
import time

import cv2

OPENCV = ["CSRT", "KCF", "MIL"]
# In OpenCV's contrib module only.
LEGACY = ["MOSSE", "MedianFlow", "TLD"]


class OpenCv:
    def __init__(self, make):
        self.tracker = make()

    def start(self, image, box):
        self.tracker.init(image, tuple(round(v) for v in box))

    def follow(self, image):
        found, box = self.tracker.update(image)
        return box if found else None


class Dlib:
    def __init__(self):
        import dlib

        self.rectangle, self.tracker = dlib.drectangle, dlib.correlation_tracker()

    def start(self, image, box):
        x, y, w, h = box
        self.tracker.start_track(image, self.rectangle(x, y, x + w - 1, y + h - 1))

    def follow(self, image):
        self.tracker.update(image)
        box = self.tracker.get_position()
        return box.left(), box.top(), box.width(), box.height()


def nano(files):
    """The maker of NanoTrack from its backbone and head; stops with a message where they are none."""
    if not hasattr(cv2, "TrackerNano_create"):
        sys.exit(f"--nano: OpenCV {cv2.__version__} has no TrackerNano; install opencv-contrib-python-headless 4.7 or later")
    for file in files:
        if not os.path.isfile(file):
            sys.exit(f"--nano: {file} is no file; expected NanoTrack's backbone and its head, as ONNX")
    params = cv2.TrackerNano_Params()
    params.backbone, params.neckhead = files

    def make():
        return OpenCv(lambda: cv2.TrackerNano_create(params))

    try:
        make()
    except cv2.error as problem:
        sys.exit(f"--nano: OpenCV cannot read {' and '.join(files)}: {problem}")
    return make


def trackers(nano_files=None):
    """Short name -> (name with version, maker), of those that are installed."""
    cv2.setNumThreads(1)
    found = {}
    for module, names in [(cv2, OPENCV), (getattr(cv2, "legacy", None), LEGACY)]:
        for name in names:
            make = getattr(module, f"Tracker{name}_create", None)
            if make:
                found[name.lower()] = (f"OpenCV {cv2.__version__} {name}", lambda make=make: OpenCv(make))
    try:
        import dlib

        found["dlib"] = (f"dlib {dlib.__version__} correlation tracker", Dlib)
    except ImportError:
        print("dlib is not installed: left out", file=sys.stderr)
    if nano_files:
        found["nano"] = (f"OpenCV {cv2.__version__} NanoTrack V2", nano(nano_files))
    else:
        print("nano: no --nano BACKBONE HEAD was given: left out", file=sys.stderr)
    return found


def follow(make, paths, box):
    """Boxes, counted from 0, and seconds of all frames."""
    tracker, boxes, seconds = make(), [], []
    for path in paths:
        image = cv2.imread(path)
        began = time.process_time()
        if boxes:
            box = tracker.follow(image) or box
        else:
            tracker.start(image, box)
        seconds.append(time.process_time() - began)
        boxes.append(box)
    return boxes, seconds


def sequences(folders):
    """(name, pictures, box of frame 1 counted from 0, frames) of each target."""
    for folder in folders:
        truths = glob.glob(f"{folder}/groundtruth_rect*.txt") or glob.glob(f"{folder}/*/groundtruth_rect*.txt")
        if not truths:
            sys.exit(f"{folder}: no sequence in this folder: expected groundtruth_rect.txt and img/, or folders that have them")
        for truth in sorted(truths):
            home = os.path.dirname(os.path.abspath(truth))
            target = re.fullmatch(r"groundtruth_rect\.?(\d*)\.txt", os.path.basename(truth))
            if not target:
                continue
            name = os.path.basename(home) + (f"-{target[1]}" if target[1] not in ("", "1") else "")
            paths = sorted(p for kind in ("jpg", "jpeg", "png", "bmp") for p in glob.glob(f"{home}/img/*.{kind}"))
            with open(truth) as file:
                lines = [line for line in file if line.strip()]
            x, y, w, h = (float(v) for v in re.split(r"[,\s]+", lines[0].strip()))
            if len(paths) < len(lines):
                sys.exit(f"{truth}: {len(lines)} boxes for {len(paths)} pictures in {home}/img")
            yield name, paths[: len(lines)], (x - 1, y - 1, w, h)


def write(path, lines):
    with open(f"{path}.tmp", "w") as file:
        file.writelines(f"{line}\n" for line in lines)
    os.replace(f"{path}.tmp", path)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seqs", nargs="+", required=True, metavar="DIR", help="sequences, or folders of sequences")
    parser.add_argument("--out", default="out-peers", metavar="DIR", help="folder for the results")
    parser.add_argument("--trackers", nargs="+", metavar="NAME", help="some of csrt kcf mil mosse medianflow tld dlib nano")
    parser.add_argument("--nano", nargs=2, metavar=("BACKBONE", "HEAD"), help="NanoTrack's two networks, ONNX files")
    args = parser.parse_args()
    installed = trackers(args.nano)
    for name in args.trackers or installed:
        if name not in installed:
            hint = "; give its files with --nano" if name == "nano" else ""
            sys.exit(f"{name} is not installed; there are {' '.join(installed)}{hint}")
        os.makedirs(f"{args.out}/{name}", exist_ok=True)
        for sequence, paths, box in sequences(args.seqs):
            file = f"{args.out}/{name}/{sequence}"
            if os.path.exists(f"{file}.txt"):
                continue
            try:
                boxes, seconds = follow(installed[name][1], paths, box)
            except Exception as problem:  # whatever it is, the other sequences are still run
                print(f"{name} on {sequence}: {problem}", file=sys.stderr)
                continue
            write(f"{file}_time.txt", (f"{s:.7f}" for s in seconds))
            write(f"{file}.txt", (f"{x + 1:.3f},{y + 1:.3f},{w:.3f},{h:.3f}" for x, y, w, h in boxes))
            print(f"{installed[name][0]} on {sequence}: {len(boxes)} frames, {sum(seconds):.1f} s", file=sys.stderr)


if __name__ == "__main__":
    main()

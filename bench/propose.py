#!/usr/bin/env python3
"""How good boxes proposed after a click are: a click at the centre of the true box, in frames 1, 10 and 40 of every sequence.

usage: foveate serve data/tracking data/tracking-wide & bench/propose.py http://127.0.0.1:8080
"""
import json
import sys
import urllib.error
import urllib.request
from collections import defaultdict


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    url = sys.argv[1].rstrip("/")

    def ask(**message):
        headers = {"Content-Type": "application/json", "Origin": url}
        request = urllib.request.Request(url + "/api", json.dumps(message).encode(), headers)
        try:
            return json.load(urllib.request.urlopen(request))
        except urllib.error.HTTPError as error:
            sys.exit(f"{message}: {json.load(error)['error']}")

    def iou(a, b):
        side = [max(0, min(a[i] + a[i + 2], b[i] + b[i + 2]) - max(a[i], b[i])) for i in (0, 1)]
        shared = side[0] * side[1]
        return shared / (a[2] * a[3] + b[2] * b[3] - shared)

    found = defaultdict(list)
    for root in ask(op="hello")["roots"]:
        for entry in ask(op="list", path=root["path"])["entries"]:
            if entry["kind"] != "images":
                continue
            opened = ask(op="open", path=entry["path"])
            for frame in (1, 10, 40):
                truth = opened["truth"][frame - 1] if frame <= len(opened["truth"]) else None
                if truth:
                    x, y, w, h = truth
                    proposed = ask(op="propose", session=opened["session"], frame=frame, at=[x + w / 2, y + h / 2])
                    found[proposed["from"]].append(iou(proposed["box"], truth))
    for source, all_ in found.items():
        share = lambda least: sum(v > least for v in all_) / len(all_)
        print(f"{source}: {len(all_)} clicks, mean IoU {sum(all_) / len(all_):.2f}, above 0.3 {share(.3):.0%}, above 0.5 {share(.5):.0%}")


main()

"""Makes a workspace of vot-toolkit from sequences in OTB's layout with img/, to evaluate trackers without a network.

    python clients/vot_workspace.py WORKSPACE SEQUENCE...
    vot evaluate --workspace WORKSPACE foveate csrt
    vot analysis --workspace WORKSPACE --format json foveate csrt

The stack has an unsupervised, a multistart and a supervised experiment. Needs OpenCV: vot-toolkit brings opencv-python; the tracker
csrt needs opencv-contrib-python in its place.
"""

import sys
from pathlib import Path

import cv2
import numpy as np
from otb_pictures import pictures

STACK = """title: Local sequences
dataset: {dataset}
experiments:
  unsupervised:
    type: unsupervised
    repetitions: 1
    analyses:
      - type: average_accuracy
        name: accuracy
        burnin: 1
  multistart:
    type: multistart
    analyses:
      - type: multistart_average_ar
        name: ar
        burnin: 10
  supervised:
    type: supervised
    repetitions: 1
    skip_initialize: 5
    analyses:
      - type: supervised_average_ar
        name: ar
        sensitivity: 30
        burnin: 10
"""

TRACKERS = """[foveate]
label = foveate
protocol = trax
command = foveate trax

[csrt]
label = OpenCV CSRT
protocol = trax
command = {python} {csrt}
"""


def add(sequence: Path, folder: Path) -> None:
    """Writes a sequence in VOT's layout: pixels count from 0, pictures are JPEG, every 50th frame, or the next with a target,
    is an anchor."""
    (folder / "color").mkdir(parents=True)
    text = (sequence / "groundtruth_rect.txt").read_text().replace(",", " ")
    boxes = np.array([[float(word) for word in line.split()] for line in text.splitlines() if line.strip()]) - [1, 1, 0, 0]
    files = pictures(sequence)[: len(boxes)]
    for i, file in enumerate(files, 1):
        target = folder / "color" / f"{i:08d}.jpg"
        if file.suffix.lower() in (".jpg", ".jpeg"):
            target.write_bytes(file.read_bytes())
        else:
            cv2.imwrite(str(target), cv2.imread(str(file)), [cv2.IMWRITE_JPEG_QUALITY, 95])
    height, width = cv2.imread(str(folder / "color" / "00000001.jpg")).shape[:2]
    (folder / "groundtruth.txt").write_text("".join(",".join(f"{v:g}" for v in box) + "\n" for box in boxes))
    # 1: forwards from here, -1: backwards; the longer way.
    anchors = [0] * len(files)
    there = np.flatnonzero(np.isfinite(boxes).all(axis=1) & (boxes[:, 2:] > 0).all(axis=1))
    for start in range(0, len(files), 50):
        for at in there[(there >= start) & (there < len(files))][:1]:
            anchors[at] = 1 if at < len(files) / 2 else -1
    (folder / "anchor.value").write_text("".join(f"{a}\n" for a in anchors))
    about = f"name={sequence.name}\nfps=30\nformat=default\nchannel.default=color\nchannels.color=color/%08d.jpg\n"
    (folder / "sequence").write_text(about + f"width={width}\nheight={height}\nlength={len(files)}\n")


def main() -> None:
    workspace, sequences = Path(sys.argv[1]), [Path(arg) for arg in sys.argv[2:]]
    folder = workspace / "sequences"
    for sequence in sequences:
        add(sequence, folder / sequence.name)
    (folder / "list.txt").write_text("".join(f"{s.name}\n" for s in sequences))
    (workspace / "stack.yaml").write_text(STACK.format(dataset=folder.resolve()))
    (workspace / "config.yaml").write_text(f"registry:\n- ./trackers.ini\nsequences: sequences\nstack: ./stack.yaml\n")
    csrt = Path(__file__).resolve().parent / "csrt_trax.py"
    (workspace / "trackers.ini").write_text(TRACKERS.format(python=sys.executable, csrt=csrt))


if __name__ == "__main__":
    main()

"""OpenCV's CSRT as a TraX tracker: the peer of `foveate trax` in vot-toolkit.

Needs vot-trax and opencv-contrib-python: opencv-python, which vot-toolkit brings, has no CSRT. In trackers.ini:
command = python clients/csrt_trax.py
"""

import sys

import cv2
from trax import Image, Rectangle, Region, Server, TraxStatus


def main() -> None:
    if not hasattr(cv2, "TrackerCSRT_create"):
        sys.exit(
            f"OpenCV {cv2.__version__} of this environment has no CSRT; run: pip uninstall opencv-python; pip install opencv-contrib-python"
        )
    tracker = None
    with Server([Region.RECTANGLE], [Image.PATH]) as server:
        while True:
            request = server.wait()
            if request.type not in (TraxStatus.INITIALIZE, TraxStatus.FRAME):
                return
            image = cv2.imread(request.image["color"].path())
            if request.type == TraxStatus.INITIALIZE:
                region, _ = request.objects[0]
                x, y, w, h = region.bounds()
                tracker = cv2.TrackerCSRT_create()
                tracker.init(image, (round(x), round(y), round(w), round(h)))
                found, box = True, (x, y, w, h)
            else:
                found, box = tracker.update(image)
            server.status([(Rectangle.create(*box), {"confidence": float(found)})])


if __name__ == "__main__":
    main()

"""Nine lines that are wrong: type checkers must find each of them, and nothing else."""

import numpy as np

import foveate
from foveate import cv2_compat

image = np.zeros((120, 160, 3), np.uint8)
tracker = foveate.Tracker("fast", channels="rgb")
seen = tracker.init(image, (40, 30, 24, 24))
ok, box = tracker.update(image)
print(box.x + 1, ok and seen.ok, seen[1].rounded())

foveate.Tracker("fast", channels="brg")  # WRONG: no such order
foveate.Tracker({"particles": 10})  # WRONG: settings are no profile
tracker.init(image)  # WRONG: no box
tracker.init(image, "40,30,24,24")  # WRONG: a text is no box
tracker.update("picture.png")  # WRONG: a path is no picture
box.left  # WRONG: no such side
ok, box, score = tracker.update(image)  # WRONG: two values, not three
foveate.Run().export("boxes.json", "json")  # WRONG: no such format
for x, y in cv2_compat.TrackerFoveate().update(image)[1]:  # WRONG: numbers, not pairs
    pass

"""A program for OpenCV's CSRT as many are: it draws, slices and indexes. Run as `csrt_program.py VIDEO OUT x,y,w,h`."""

import sys

import cv2

video_path, out_path = sys.argv[1], sys.argv[2]
box = tuple(int(v) for v in sys.argv[3].split(","))

video = cv2.VideoCapture(video_path)
if not video.isOpened():
    sys.exit(f"cannot open {video_path}")
ok, frame = video.read()
height, width = frame.shape[:2]
writer = cv2.VideoWriter(out_path, cv2.VideoWriter_fourcc(*"MJPG"), 25, (width, height))

tracker = cv2.TrackerCSRT_create()
tracker.init(frame, box)

# The target as it was first, to compare with.
x, y, w, h = box
template = cv2.cvtColor(frame[y : y + h, x : x + w], cv2.COLOR_BGR2GRAY)
path = [(x + w // 2, y + h // 2)]
boxes = [box]
lost = 0

while True:
    more, frame = video.read()
    if not more:
        break
    ret = tracker.update(frame)
    if ret[0]:
        # Drawing with a box as it is, and with its corners.
        crop = frame[ret[1][1] : ret[1][1] + ret[1][3], ret[1][0] : ret[1][0] + ret[1][2]].copy()
        cv2.rectangle(frame, ret[1], (0, 255, 0), 2)
        (x, y, w, h) = ret[1]
        p1, p2 = (x, y), (x + w, y + h)
        cv2.rectangle(frame, p1, p2, (255, 0, 0), 1)
        centre = (x + w // 2, y + h // 2)
        cv2.circle(frame, centre, 3, (0, 0, 255), -1)
        path.append(centre)
        # Slicing: the target beside its first look.
        grey = cv2.cvtColor(crop, cv2.COLOR_BGR2GRAY)
        small = cv2.resize(grey, (template.shape[1], template.shape[0]))
        score = cv2.matchTemplate(small, template, cv2.TM_CCOEFF_NORMED)[0, 0]
        frame[0 : template.shape[0], 0 : template.shape[1]] = cv2.cvtColor(small, cv2.COLOR_GRAY2BGR)
        cv2.putText(frame, f"{score:.2f}", (x, y - 5), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (255, 255, 255), 1)
        blurred = cv2.GaussianBlur(frame[y : y + h, x : x + w], (5, 5), 0)
        frame[y : y + h, x : x + w] = blurred
    else:
        lost += 1
        cv2.putText(frame, "lost", (5, 15), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 255), 1)
    for a, b in zip(path, path[1:]):
        cv2.line(frame, a, b, (0, 255, 255), 1)
    boxes.append(ret[1])
    writer.write(frame)

writer.release()
video.release()
for b in boxes:
    print("%d,%d,%d,%d" % b)
print("lost", lost, file=sys.stderr)

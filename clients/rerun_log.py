"""A track in rerun's viewer: picture, box, particles, P(lost) and the learned gaze, frame by frame.

    python clients/rerun_log.py VIDEO X Y W H out.rrd     # then: rerun out.rrd
"""

import sys

import foveate
import numpy as np
import rerun as rr


def log(frame: int, image: np.ndarray, seen) -> None:
    """Logs a frame and its `foveate.Result`."""
    rr.set_time("frame", sequence=frame)
    # As it is, a picture of 640 x 480 takes 900 kB.
    rr.log("video", rr.Image(image).compress(jpeg_quality=85))
    x, y, w, h = seen.box
    rr.log("video/box", rr.Boxes2D(array=[x, y, w, h], array_format=rr.Box2DFormat.XYWH, labels=[seen.status]))
    # Brighter is heavier.
    weights = np.asarray(seen.weights) / max(np.max(seen.weights), 1e-300)
    colours = np.stack([np.full_like(weights, 255), 255 * weights, 0 * weights], axis=1).astype(np.uint8)
    rr.log("video/particles", rr.Points2D(np.asarray(seen.particles)[:, :2], colors=colours, radii=0.7))
    rr.log("p_lost", rr.Scalars(seen.p_lost))
    if seen.gaze is not None:
        rr.log("gaze", rr.Points2D([list(seen.gaze)[:2]]))


def main() -> None:
    video, *box, out = sys.argv[1:]
    rr.init("foveate")
    rr.save(out)
    tracker = foveate.Tracker("balanced")
    for frame, image in enumerate(foveate.Video(video)):
        if frame == 0:
            tracker.init(image, [float(v) for v in box])
        else:
            log(frame, image, tracker.update(image))


if __name__ == "__main__":
    main()

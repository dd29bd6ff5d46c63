#!/usr/bin/env python3
"""Time of a frame by sizes of picture and target, on drawn video.

  bench/sizes.py PROGRAM [--config natural] [--frames 80]

Draws a textured square that swings over another texture. Sends the pixels to `foveate track - --stream json` one frame at a time:
"track" and "read" are what its threads took for each. Encodes the same frames as H.264 and runs `foveate look`, whose built-in decoder
passes over them: "decode". Prints a row for each cell: mean, 99 % and worst frame of track, the other two, and the stage that takes
longest, which bounds a pipeline. All are milliseconds of processor time, so other programs change them little. Linux; needs numpy and
ffmpeg with libx264.
"""
import argparse, json, os, subprocess, tempfile
import numpy as np

SIZES = [(320, 240), (640, 480), (854, 480), (1280, 720), (1920, 1080), (3840, 2160), (7680, 4320)]
TARGETS = [20, 50, 100, 200, 400, 800]


def texture(rng, width, height, block):
    few = rng.integers(0, 256, (height // block + 2, width // block + 2, 3), dtype=np.uint8)
    return np.repeat(np.repeat(few, block, 0), block, 1)[:height, :width]


def frames(width, height, side, count):
    """Pictures and boxes (x, y from 0)."""
    rng = np.random.default_rng(5)
    ground = texture(rng, width, height, max(4, width // 80)) // 2 + 64
    target = texture(rng, side, side, max(2, side // 8))
    for t in range(count):
        x = int((width - side) / 2 * (1 + 0.25 * np.sin(t / 9)))
        y = int((height - side) / 2 * (1 + 0.25 * np.sin(t / 13)))
        picture = ground.copy()
        picture[y:y + side, x:x + side] = target
        yield picture, (x + 1, y + 1, side, side)


def taken(child):
    """Milliseconds of processor time of all threads of a process but the one that reads frames, which started last, and of that one."""
    folder = f"/proc/{child.pid}/task/"
    times = [int(open(f"{folder}{thread}/schedstat").read().split()[0]) / 1e6 for thread in sorted(os.listdir(folder), key=int)]
    return np.array([sum(times[:-1]), times[-1]])


def track(program, config, size, side, count):
    """Milliseconds of each frame from the seventh on for tracking and reading, and the share of frames with status tracking."""
    command = [program, "track", "-", "--raw", f"{size[0]}x{size[1]}", "-c", config, "--stream", "json", "--every-frame", "--threads", "1",
               "--no-video", "--no-report", "--max-memory", "6G"]
    first = next(frames(*size, side, 1))[1]
    with tempfile.TemporaryDirectory() as out:
        command += ["--init", ",".join(map(str, first)), "--out", out + "/out"]
        child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        times, good = [], 0
        for picture, _ in frames(*size, side, count):
            child.stdin.write(picture.tobytes())
            child.stdin.flush()
            good += json.loads(child.stdout.readline())["status"] == "tracking"
            times.append(taken(child))
        child.stdin.close()
        assert child.wait() == 0
    return np.diff(times, axis=0)[6:].T, good / count


def decode(program, size, side, count):
    """Milliseconds a frame of the built-in decoder, from 10 frames to all."""
    with tempfile.TemporaryDirectory() as folder:
        film = os.path.join(folder, "film.mp4")
        command = ["ffmpeg", "-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{size[0]}x{size[1]}", "-i", "-", "-c:v", "libx264",
                   "-preset", "veryfast", "-pix_fmt", "yuv420p", film]
        coder = subprocess.Popen(command, stdin=subprocess.PIPE)
        for picture, _ in frames(*size, side, count):
            coder.stdin.write(picture.tobytes())
        coder.stdin.close()
        assert coder.wait() == 0

        def milliseconds(frame):
            command = [program, "look", film, "--frame", str(frame), "--most", "1", "--decoder", "builtin", "--max-memory", "6G", "--threads",
                       "1", "--out", os.path.join(folder, "look.png")]
            child = subprocess.Popen(command, stdout=subprocess.DEVNULL)
            _, status, used = os.wait4(child.pid, 0)
            assert status == 0
            return 1e3 * (used.ru_utime + used.ru_stime)

        return max(0.0, (milliseconds(count) - milliseconds(10)) / (count - 10))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program")
    parser.add_argument("--config", default="natural")
    parser.add_argument("--frames", type=int, default=80)
    args = parser.parse_args()
    print("| picture | target | mean | 99 % | worst | read | decode | bound by | tracking |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    for size in SIZES:
        count = max(24, args.frames // max(1, size[0] // 1920))
        decoded = decode(args.program, size, min(100, size[1] // 3), count)
        for side in (side for side in TARGETS if 1.5 * side <= size[1]):
            (times, reads), good = track(args.program, args.config, size, side, count)
            mean, read = np.mean(times), np.median(reads)
            stage = max([(mean, "track"), (read, "read"), (decoded, "decode")])[1]
            print(f"| {size[0]} x {size[1]} | {side} px | {mean:.2f} | {np.quantile(times, 0.99):.2f} | {max(times):.2f} | {read:.2f} | "
                  f"{decoded:.2f} | {stage} | {100 * good:.0f} % |", flush=True)


main()

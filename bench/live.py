#!/usr/bin/env python3
"""Latency and memory of `foveate track - --stream`, with a video made here (640 x 480, a square that moves over noise).

  bench/live.py PROGRAM latency [--seconds 30] [--profile natural|fast]   30 frames a second
  bench/live.py PROGRAM flood   [--seconds 120]                           as many as the pipe takes; the newest is tracked

Prints medians, 99 % and 99.9 % of milliseconds from the last byte of a frame written to its JSON line read (`outside`), and as foveate
reports them (`latency_ms`); frames dropped; resident memory.
"""
import argparse, json, random, subprocess, tempfile, threading, time

W, H, SIDE = 640, 480, 64


def frames(count=90):
    rng = random.Random(1)
    noise = bytes(80 + (b >> 3) for b in rng.randbytes(W * H))
    target = [bytes(150 + 80 * ((x // 8 + y // 8) % 2) for x in range(SIDE)) for y in range(SIDE)]
    chroma = bytes([128]) * (W * H // 2)
    made = []
    for t in range(count):
        # There and back, so that the video can be repeated.
        left = 100 + 3 * (t if t < count // 2 else count - t)
        picture = bytearray(noise)
        for y, row in enumerate(target):
            at = (200 + y) * W + left
            picture[at:at + SIDE] = row
        made.append(b"FRAME\n" + bytes(picture) + chroma)
    return made


def resident(pid):
    for line in open(f"/proc/{pid}/status"):
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    return 0.0


def spread(values):
    values = sorted(values)
    at = lambda share: values[int(share * (len(values) - 1))]
    return f"median {at(0.5):.2f}, 99 % {at(0.99):.2f}, 99.9 % {at(0.999):.2f}, most {values[-1]:.2f}"


def main():
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    args.add_argument("program")
    args.add_argument("what", choices=["latency", "flood"])
    args.add_argument("--seconds", type=float)
    args.add_argument("--profile", default="natural")
    args = args.parse_args()
    flood = args.what == "flood"
    seconds = args.seconds or (120 if flood else 30)
    made = frames()
    out = tempfile.mkdtemp()
    command = [args.program, "--threads", "1", "track", "-", "--config", {"fast": "natural-fast"}.get(args.profile, args.profile)]
    command += ["--init", f"101,201,{SIDE},{SIDE}", "--stream", "--out", out + "/out", "--no-report"]
    command += ["--max-latency", "1000"] if flood else []
    run = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    written, lines, memory = {}, [], []

    def read():
        for line in run.stdout:
            now, line = time.perf_counter(), json.loads(line)
            lines.append((now, line))

    reader = threading.Thread(target=read)
    reader.start()
    run.stdin.write(f"YUV4MPEG2 W{W} H{H} F30:1 Ip A1:1 C420 XCOLORRANGE=LIMITED\n".encode())
    began, n = time.perf_counter(), 0
    while time.perf_counter() - began < seconds:
        run.stdin.write(made[n % len(made)])
        run.stdin.flush()
        n += 1
        written[n] = time.perf_counter()
        if not flood:
            time.sleep(max(0, began + n / 30 - time.perf_counter()))
        if n % 100 == 0:
            memory.append(resident(run.pid))
    run.stdin.close()
    reader.join()
    run.wait()
    skip = 30  # the first frames fill buffers
    print(f"{n} frames written in {seconds:.0f} s, {len(lines)} tracked, {lines[-1][1]['dropped']} dropped, status {run.returncode}")
    parts = [("all", lines[skip:])]
    if flood:
        half = began + seconds / 2
        parts += [("first half", [l for l in lines[skip:] if l[0] < half]), ("second half", [l for l in lines[skip:] if l[0] >= half])]
    for name, part in parts:
        outside = [1e3 * (now - written[line["frame"]]) for now, line in part if line["frame"] in written]
        print(f"{name}: outside ms: {spread(outside)}; latency_ms: {spread([line['latency_ms'] for _, line in part])}")
    if memory:
        settled = memory[len(memory) // 10:]
        print(f"resident MiB: {settled[0]:.1f} after a tenth, {settled[-1]:.1f} at the end, {max(settled):.1f} at most")
    lost = sum(line["status"] == "lost" for _, line in lines)
    print(f"lost in {lost} of {len(lines)} frames")


main()

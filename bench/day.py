#!/usr/bin/env python3
"""Hours of video through a camera with faults: an RTSP server on the loopback sends Motion JPEG, and `foveate track` follows a square.

  bench/day.py PROGRAM [--hours 24] [--minutes 35] [--seed 1] [--faults 1] [--size 64x48] [--config natural-fast] [OPTION ...]

Frames are 1/25 s of video apart and sent as fast as they are tracked, until `--hours` of video or `--minutes` of time are over. Other
options are those of foveate track. Faults are random, each kind at the rate FAULTS an hour of video, times `--faults`. Needs ffmpeg.
Prints a row for each hour of video: resident memory of foveate, its open files and threads, latency, and the share of frames with the
box on the target (IoU of 0.5 or more). Then faults sent against faults in the log, and how many frames after a fault the box is on the
target. The exit status is 1 if a count differs, a track is not resumed, or memory or files grow.
"""
import argparse, collections, json, os, random, re, socket, statistics, struct, subprocess, tempfile, threading, time

# Faults an hour of video. A stall longer than 10 s and a lost connection make foveate reconnect.
FAULTS = {"short stall": 6, "long stall": 2, "corrupt frame": 120, "size change": 20, "clock jump": 20, "lost connection": 8}
# Frames a second, frames until the target is back, its side, and frames that are sent before they are tracked.
RATE, CYCLE, SIDE, AHEAD = 25, 1200, 16, 40
SETTLED = 50  # frames between faults, and until the target must be found again


def truth(n, w, h):
    """Left and top of the target, from 0: there and back, at most a tenth of a pixel a frame."""
    there = abs(n % CYCLE - CYCLE // 2) / (CYCLE // 2)
    return round(4 + there * (w - SIDE - 8)), round(4 + (1 - there) * (h - SIDE - 8))


def jpegs(w, h, scale):
    """The cycle as (scan, quantisation tables) of JPEG files."""
    rng = random.Random(1)
    noise = bytes(70 + (b >> 2) for b in rng.randbytes(w * h))
    target = [bytes(150 + 90 * ((x // 4 + y // 4) % 2) for x in range(SIDE)) for y in range(SIDE)]
    chroma = bytes([128]) * (w * h // 2)
    video = [f"YUV4MPEG2 W{w} H{h} F{RATE}:1 Ip A1:1 C420jpeg\n".encode()]
    for n in range(CYCLE):
        picture, (left, top) = bytearray(noise), truth(n, w, h)
        for y, row in enumerate(target):
            picture[(top + y) * w + left:(top + y) * w + left + SIDE] = row
        video += [b"FRAME\n", bytes(picture), chroma]
    command = f"ffmpeg -v error -f yuv4mpegpipe -i - -vf scale={w * scale}:{h * scale}:flags=neighbor -pix_fmt yuvj420p"
    command += " -c:v mjpeg -huffman default -q:v 3 -f mjpeg -"
    data = subprocess.run(command.split(), input=b"".join(video), stdout=subprocess.PIPE, check=True).stdout
    made = []
    for file in data.split(b"\xff\xd8\xff")[1:]:
        file, at, tables = b"\xff\xd8\xff" + file, 2, b""
        while True:
            marker, size = struct.unpack(">xBH", file[at:at + 4])
            part, at = file[at + 4:at + 2 + size], at + 2 + size
            if marker == 0xDB:
                tables += b"".join(part[i + 1:i + 65] for i in range(0, len(part), 65))
            if marker == 0xDA:
                break
        made.append((file[at:-2], (2 * tables)[:128]))
    assert len(made) == CYCLE
    return made


class Camera:
    """Serves one stream by RTSP, its RTP in the same connection. `lines` is how many frames were tracked."""

    def __init__(self, args, w, h):
        self.args, self.w, self.h = args, w, h
        self.videos = {scale: jpegs(w, h, scale) for scale in [1, 2]}
        self.rng, self.sent, self.lines, self.over = random.Random(args.seed), 0, 0, False
        self.faults, self.log = collections.Counter(), []
        self.scale, self.clock, self.last, self.corrupt, self.latest = 1, 0, 0, None, 0
        self.began = time.monotonic()
        self.server = socket.create_server(("127.0.0.1", 0))
        self.address = f"rtsp://127.0.0.1:{self.server.getsockname()[1]}/live"
        threading.Thread(target=self.serve, daemon=True).start()

    def serve(self):
        while not self.over:
            peer = self.server.accept()[0]
            try:
                peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self.play(peer)
            except OSError:
                pass
            peer.close()

    def play(self, peer):
        asked = peer.makefile("rb")
        sdp = "v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=-\r\nt=0 0\r\nm=video 0 RTP/AVP 26\r\na=control:track\r\n"
        while True:
            head = [asked.readline().decode()]
            while head[-1].strip():
                head.append(asked.readline().decode())
            if not head[0]:
                return
            number = next(line for line in head if line.startswith("CSeq"))
            more, body = "", ""
            if head[0].startswith("DESCRIBE"):
                more, body = f"Content-Type: application/sdp\r\nContent-Length: {len(sdp)}\r\n", sdp
            elif head[0].startswith("SETUP"):
                more = "Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\nSession: 1\r\n"
            elif head[0].startswith("OPTIONS"):
                more = "Public: DESCRIBE, SETUP, PLAY\r\n"
            peer.sendall(f"RTSP/1.0 200 OK\r\n{number.strip()}\r\n{more}\r\n{body}".encode())
            if head[0].startswith("PLAY"):
                break
        start, tracked, self.latest = self.sent, self.lines, 0
        while not self.over:
            # As fast as the frames are tracked; ffmpeg reads some before the first one.
            waited = time.monotonic() + 0.1
            while self.sent - start > self.lines - tracked + AHEAD and time.monotonic() < waited:
                time.sleep(0.0005)
            running = self.lines > tracked + SETTLED
            if running and self.sent - self.last > 2 * SETTLED:
                kind = next((kind for kind, rate in FAULTS.items() if self.rng.random() < self.args.faults * rate / 3600 / RATE), None)
                # Another jump before the stamps are beyond those of an earlier one could not be distinguished from it.
                if kind and (kind != "clock jump" or self.stamp() >= self.latest):
                    self.fault(kind)
                    if kind == "lost connection":
                        return
                    if kind == "long stall":
                        # Until foveate gives the connection up.
                        peer.settimeout(60)
                        while peer.recv(4096):
                            pass
                        return
            self.send(peer)
            if self.sent >= self.args.hours * 3600 * RATE or time.monotonic() - self.began > 60 * self.args.minutes:
                self.over = True

    def fault(self, kind):
        self.faults[kind] += 1
        self.last = self.sent
        self.log.append((kind, self.sent, self.lines))
        if kind == "short stall":
            time.sleep(self.rng.uniform(0.5, 3))
        elif kind == "corrupt frame":
            self.corrupt = self.rng.uniform(0.1, 0.8)
        elif kind == "size change":
            self.scale = 3 - self.scale
        elif kind == "clock jump":
            self.clock += round(90000 * self.rng.choice([self.rng.uniform(-60, -1), self.rng.uniform(20, 1800)]))

    def stamp(self):
        return self.sent * 90000 // RATE + self.clock

    def send(self, peer):
        scan, tables = self.videos[self.scale][self.sent % CYCLE]
        if self.corrupt:
            scan, self.corrupt = scan[:int(self.corrupt * len(scan))], None
        sides = bytes([self.w * self.scale // 8, self.h * self.scale // 8])
        packet = struct.pack(">BBHII", 0x80, 0x80 | 26, self.sent & 0xFFFF, self.stamp() & 0xFFFFFFFF, 1)
        packet += bytes(4) + b"\x01\xff" + sides + struct.pack(">HH", 0, len(tables)) + tables + scan
        peer.sendall(struct.pack(">cBH", b"$", 0, len(packet)) + packet)
        self.latest = max(self.latest, self.stamp())
        self.sent += 1


def overlap(box, left, top):
    across = max(0, min(box["x"] + box["w"], left + SIDE) - max(box["x"], left))
    down = max(0, min(box["y"] + box["h"], top + SIDE) - max(box["y"], top))
    return across * down / (box["w"] * box["h"] + SIDE * SIDE - across * down)


def state(pid):
    text = open(f"/proc/{pid}/status").read()
    number = lambda key: int(re.search(rf"{key}:\s+(\d+)", text)[1])
    return number("VmRSS") / 1024, len(os.listdir(f"/proc/{pid}/fd")), number("Threads")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    for name, kind, default in [("hours", float, 24), ("minutes", float, 35), ("seed", int, 1), ("faults", float, 1), ("size", str, "64x48"), ("config", str, "natural-fast")]:
        parser.add_argument(f"--{name}", type=kind, default=default)
    args, options = parser.parse_known_args()
    w, h = map(int, args.size.split("x"))
    camera, out = Camera(args, w, h), tempfile.mkdtemp()
    left, top = truth(0, w, h)
    command = [args.program, "--threads", "1", "track", camera.address, "--config", args.config, "--init", f"{left + 1},{top + 1},{SIDE},{SIDE}", "--stream"]
    command += ["--every-frame", "--no-report", "--out", out + "/out", *options]
    log = open(out + "/log", "w+")
    run = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=log)
    hours, on, samples, last = collections.defaultdict(list), [], [], {}
    for text in run.stdout:
        last = json.loads(text)
        # A frame of the last few that were sent: in these the target moves by three pixels.
        hit = overlap(last["bbox"], *truth(max(0, camera.sent - AHEAD // 2), w, h)) >= 0.5
        on.append(hit)
        hours[camera.lines // (3600 * RATE)].append((last["latency_ms"], hit))
        if camera.lines % 2000 == 1999:
            samples.append((camera.lines // (3600 * RATE), *state(run.pid)))
        camera.lines += 1
        if camera.over:
            break
    camera.over = True
    run.terminate()
    run.stdout.read()
    status = run.wait()
    log.seek(0)
    report(camera, hours, on, samples, last, log.read(), status)


def report(camera, hours, on, samples, last, log, status):
    print(f"{camera.sent} frames sent, {camera.lines} tracked in {time.monotonic() - camera.began:.0f} s, exit status {status}; time of the last {last.get('time')} s")
    print("| hour of video | resident MiB | files | threads | latency, median | 99 % | on the target |\n| --- | --- | --- | --- | --- | --- | --- |")
    rows = []
    for hour, frames in hours.items():
        times, here = sorted(ms for ms, _ in frames), [s for s in samples if s[0] == hour]
        if here:
            rows.append([max(s[i] for s in here) for i in [1, 2, 3]])
            print(f"| {hour + 1} | {rows[-1][0]:.1f} | {rows[-1][1]} | {rows[-1][2]} | {statistics.median(times):.2f} ms |"
                  f" {times[int(0.99 * (len(times) - 1))]:.2f} ms | {sum(hit for _, hit in frames) / len(frames):.4f} |")
    number = lambda pattern: sum(int(n) for n in re.findall(pattern, log))
    reopened = camera.faults["long stall"] + camera.faults["lost connection"]
    counts = [("corrupt frame", camera.faults["corrupt frame"], last.get("damaged", 0)),
              ("size change", camera.faults["size change"], number(r"size of the pictures changed (\d+) time")),
              ("clock jump", camera.faults["clock jump"], number(r"time stamps jumped (\d+) time")),
              ("long stall", camera.faults["long stall"], log.count("nothing came for 10 s")),
              ("connection opened again", reopened, number(r"opened again (\d+) time"))]
    bad = status != 143
    print("| fault | sent | in the log |\n| --- | --- | --- |")
    for name, sent, found in counts:
        # ffmpeg may report a corrupt frame in two lines, with a frame between them.
        bad |= not sent <= found <= (1.1 * sent + 1 if name == "corrupt frame" else sent)
        print(f"| {name} | {sent} | {found} |")
    for kind in FAULTS:
        waits = [next((i for i, hit in enumerate(on[at + AHEAD:at + AHEAD + 10 * SETTLED]) if hit), None) for k, _, at in camera.log if k == kind and at + 10 * SETTLED < len(on)]
        lost = sum(wait is None for wait in waits)
        bad |= lost > 0
        print(f"{kind}: {camera.faults[kind]}; on the target again in {len(waits) - lost} of {len(waits)}, after {max((w for w in waits if w is not None), default=0)} frames at most")
    if len(rows) > 1 and (rows[-1][0] > 1.1 * rows[0][0] + 1 or rows[-1][1] > rows[0][1] or rows[-1][2] > rows[0][2]):
        bad = True
        print("memory, files or threads grow")
    print(log[-3000:])
    raise SystemExit(bad)


main()

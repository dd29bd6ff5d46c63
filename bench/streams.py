#!/usr/bin/env python3
"""Frames sent, tracked, dropped and reported for each kind of source, with servers and senders on the loopback.

  bench/streams.py PROGRAM [NAME ...]      all kinds, or those whose names contain one of NAME

Needs ffmpeg with libx264 and libsrt. Prints one row for each kind: frames sent, then frames tracked and dropped by default and with
--every-frame, the exit status, and the text on standard error besides the summary. Frames that are neither tracked nor dropped make the
exit status 1, but for SRT, which throws away what is on its way when the sender closes.
"""
import http.server, json, os, re, shlex, subprocess, sys, tempfile, threading, time

FRAMES, RATE = 150, 25
PIPE = "-fps_mode passthrough -pix_fmt yuv420p -f yuv4mpegpipe -"
LIVE = "-c:v libx264 -preset ultrafast -tune zerolatency -g 25 -pix_fmt yuv420p"


class Handler(http.server.BaseHTTPRequestHandler):
    """/ranges/NAME, /whole/NAME (a length, but no parts), /unsized/NAME."""
    protocol_version = "HTTP/1.1"

    def log_message(self, *_):
        pass

    def do_GET(self):
        how, name = self.path.lstrip("/").split("/", 1)
        try:
            data = open(os.path.join(self.server.folder, name), "rb").read()
        except OSError:
            self.send_error(404)
            return
        part = re.match(r"bytes=(\d+)-", self.headers.get("Range") or "") if how == "ranges" else None
        start = int(part[1]) if part else 0
        self.send_response(206 if part else 200)
        if part:
            self.send_header("Content-Range", f"bytes {start}-{len(data) - 1}/{len(data)}")
        if how != "unsized":
            self.send_header("Content-Length", str(len(data) - start))
        self.send_header("Connection", "close")
        self.end_headers()
        try:
            self.wfile.write(data[start:])
        except OSError:
            pass
        self.close_connection = True


def ffmpeg(args, **more):
    return subprocess.run(["ffmpeg", "-v", "error", "-y", *shlex.split(args)], check=True, **more)


def sender(args, folder, delay=0.0):
    """Sends repeatedly until a receiver takes it once."""
    def work():
        time.sleep(delay)
        for _ in range(100):
            done = subprocess.run(["ffmpeg", "-v", "error", *shlex.split(args)], cwd=folder, stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            if done.returncode == 0:
                return
            time.sleep(0.1)
    threading.Thread(target=work, daemon=True).start()


def main():
    program, names = os.path.abspath(sys.argv[1]), sys.argv[2:]
    folder = tempfile.mkdtemp()
    join = lambda name: os.path.join(folder, name)
    # B-frames, as recordings have them.
    ffmpeg(f"-f lavfi -i testsrc2=size=320x240:rate={RATE} -frames:v {FRAMES} -c:v libx264 -preset veryfast -bf 2 -g 50 -pix_fmt yuv420p -movflags +faststart {join('first.mp4')}")
    for args, name in [("-c copy", "last.mp4"), ("-c copy", "a.ts"), ("-c copy", "a.mkv"), ("-c:v mjpeg -q:v 4 -pix_fmt yuvj420p", "a.mjpeg"),
                       ("-pix_fmt yuv420p", "a.y4m"), ("-c copy -f hls -hls_time 2 -hls_list_size 0", "list.m3u8")]:
        ffmpeg(f"-i {join('first.mp4')} {args} {join(name)}")
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.folder = folder
    threading.Thread(target=server.serve_forever, daemon=True).start()
    web, port = f"http://127.0.0.1:{server.server_port}", [40000 + os.getpid() % 10000]

    def fresh():
        port[0] += 1
        return port[0]

    def listened(scheme, send):
        def start():
            address = f"{scheme}://127.0.0.1:{fresh()}/live"
            sender(f"-re -i first.mp4 {LIVE} {send} {address}", folder)
            return address, ["--listen", "--reconnect", "2"], None
        return start

    def piped(command, prepare=lambda: ""):
        def start():
            more = prepare()
            return "-", [], command.replace("ADDRESS", more)
        return start

    def network(scheme, receive, send, delay=0.0):
        def start():
            at = f"{scheme}://127.0.0.1:{fresh()}"
            sender(f"-re -i first.mp4 {LIVE} -f mpegts {shlex.quote(at + send)}", folder, delay)
            return "-", [], f"timeout 60 ffmpeg -v error -nostdin -i {shlex.quote(at + receive)} {PIPE}"
        return start

    def live_list():
        for name in os.listdir(folder):
            if name.startswith("live"):
                os.remove(join(name))
        sender(f"-re -i first.mp4 {LIVE} -f hls -hls_time 1 -hls_list_size 0 live.m3u8", folder)
        while not os.path.exists(join("live.m3u8")):
            time.sleep(0.05)
        return f"{web}/ranges/live.m3u8", [], None

    plain = lambda source: lambda: (source, [], None)
    kinds = {
        "file": plain(join("first.mp4")),
        "http, ranges, MP4": plain(f"{web}/ranges/first.mp4"),
        "http, ranges, MP4 with its index at the end": plain(f"{web}/ranges/last.mp4"),
        "http, ranges, MPEG-TS": plain(f"{web}/ranges/a.ts"),
        "http, no ranges, MP4": plain(f"{web}/whole/first.mp4"),
        "http, no ranges, MP4 with its index at the end": plain(f"{web}/whole/last.mp4"),
        "http, no ranges, MPEG-TS": plain(f"{web}/whole/a.ts"),
        "http, no length, Matroska": plain(f"{web}/unsized/a.mkv"),
        "http, no length, MPEG-TS": plain(f"{web}/unsized/a.ts"),
        "HLS, finished": plain(f"{web}/ranges/list.m3u8"),
        "HLS, live": live_list,
        "RTSP, --listen": listened("rtsp", "-rtsp_transport tcp -f rtsp"),
        "http, --listen, MPEG-TS": listened("http", "-f mpegts"),
        "UDP through a pipe": network("udp", "?timeout=3000000", "?pkt_size=1316", 1.0),
        "TCP through a pipe": network("tcp", "?listen=1", ""),
        "SRT through a pipe": network("srt", "?mode=listener", "?mode=caller"),
        "pipe, yuv4mpeg": piped(f"cat {join('a.y4m')}"),
        "pipe, Motion JPEG through ffmpeg": piped(f"cat {join('a.mjpeg')} | ffmpeg -v error -i - {PIPE}"),
        "pipe, MPEG-TS through ffmpeg": piped(f"cat {join('a.ts')} | ffmpeg -v error -i - {PIPE}"),
        "pipe, MP4 through ffmpeg": piped(f"cat {join('first.mp4')} | ffmpeg -v error -i - {PIPE}"),
        "pipe, MPEG-TS as it is": piped(f"cat {join('a.ts')}"),
    }
    lost = 0
    print("| source | sent | tracked | dropped | with --every-frame | status | besides |\n| --- | --- | --- | --- | --- | --- | --- |")
    for name, start in kinds.items():
        if names and not any(word in name for word in names):
            continue
        cells, reason, statuses = [], "", []
        for every in [False, True]:
            source, options, pipe = start()
            options = options + (["--every-frame"] if every and "file" != name else [])
            command = [program, "--threads", "1", "track", source, "--init", "41,41,40,40", "--profile", "fast", "--no-report", "--no-video",
                       "--stream", "--out", join("out"), *options]
            feed = subprocess.Popen(pipe, shell=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, cwd=folder) if pipe else None
            run = subprocess.run(command, stdin=feed.stdout if feed else subprocess.DEVNULL, capture_output=True, text=True, timeout=120)
            if feed:
                feed.stdout.close()
                feed.wait()
            lines = [json.loads(line) for line in run.stdout.splitlines()]
            tracked, dropped = len(lines), lines[-1]["dropped"] if lines else 0
            cells.append((tracked, dropped))
            statuses.append(run.returncode)
            said = [line for line in run.stderr.splitlines() if line.startswith("foveate: ")]
            reason = reason or "; ".join(said).replace(folder, "").replace("foveate: ", "").replace("|", "\\|")
            lost += run.returncode == 0 and tracked + dropped != FRAMES and not name.startswith("SRT")
        (tracked, dropped), (all_, none) = cells
        print(f"| {name} | {FRAMES} | {tracked} | {dropped} | {all_}{f' and {none} dropped' if none else ''} | {'/'.join(map(str, sorted(set(statuses))))} | {reason} |", flush=True)
    sys.exit(lost > 0)


main()

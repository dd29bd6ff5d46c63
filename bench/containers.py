#!/usr/bin/env python3
"""Containers and codecs against ffprobe: number of frames, time of each frame, size, upright, shape of the pixels.

Makes a short video of each kind with ffmpeg (variable frame rate where the container has it), tracks through it, and compares track.csv and
annotated.mp4, and the picture that `foveate look` writes, with what ffprobe and ffmpeg report. A kind is `equal`, `said` (equal but for a warning), `refused` (an error with its
reason), or `WRONG`. Needs python3, ffmpeg and ffprobe. Exit 0: no kind is wrong.

    python3 bench/containers.py [--foveate target/debug/foveate] [--only mkv] [--keep FOLDER]
"""
import argparse
import csv
import json
import subprocess
import sys
import tempfile
from pathlib import Path

# Frames of 25 a second, of which two in seven are left out: each other one is shown up to three times as long.
VARIABLE = ["-vf", "select='not(eq(mod(n,7),2)+eq(mod(n,7),3))'", "-fps_mode", "vfr"]
H264 = ["-c:v", "libx264", "-bf", "2", "-g", "12", "-pix_fmt", "yuv420p"]
HEVC = ["-c:v", "libx265", "-x265-params", "log-level=none", "-pix_fmt", "yuv420p"]
VP8 = ["-c:v", "libvpx", "-deadline", "realtime", "-cpu-used", "8"]
VP9 = ["-c:v", "libvpx-vp9", "-deadline", "realtime", "-cpu-used", "8", "-pix_fmt", "yuv420p"]
AV1 = ["-c:v", "libsvtav1", "-preset", "12", "-pix_fmt", "yuv420p"]
MPEG2 = ["-c:v", "mpeg2video", "-bf", "2", "-q:v", "3"]
MPEG4 = ["-c:v", "mpeg4", "-bf", "2", "-q:v", "3"]
DV = ["-pix_fmt", "yuv420p", "-c:v", "dvvideo"]
SOUND = ["-f", "lavfi", "-i", "sine=duration=2"]


def shape(ratio: str) -> list[str]:
    return ["-vf", f"setsar={ratio}"]


# Name, file, what ffmpeg does after its input; IN is a file that another row made.
KINDS: list[tuple[str, str, list[str]]] = [
    ("MP4, H.264", "plain.mp4", H264),
    ("MP4, H.264, variable rate", "vfr.mp4", [*VARIABLE, *H264]),
    ("MP4, H.264, trimmed by copy (edit list)", "trim.mp4", ["-ss", "0.7", "-i", "IN/vfr.mp4", "-map", "1", "-c", "copy"]),
    ("MP4, H.264, starts at 5 s", "late.mp4", ["-i", "IN/vfr.mp4", "-map", "1", "-c", "copy", "-output_ts_offset", "5"]),
    ("MP4, H.264, in fragments", "fragments.mp4", [*VARIABLE, *H264, "-movflags", "frag_keyframe+empty_moov"]),
    ("MP4, H.264, turned by 90 degrees", "turned.mp4", ["-i", "IN/vfr.mp4", "-map", "1", "-c", "copy", "-metadata:s:v", "rotate=90"]),
    ("MP4, H.264, pixels 64:45", "wide.mp4", [*shape("64/45"), *H264]),
    ("MP4, H.264, pixels 8:9, turned by 270 degrees", "narrow.mp4", ["-i", "IN/narrow0.mp4", "-map", "1", "-c", "copy", "-metadata:s:v", "rotate=270"]),
    ("MP4, H.264 4:4:4, pixels 4:3", "wide444.mp4", [*shape("4/3"), "-c:v", "libx264", "-pix_fmt", "yuv444p"]),
    ("MP4, H.264 and sound that begins first", "sound.mp4", [*SOUND, "-map", "1", "-map", "0", "-vf", "setpts=PTS+0.5/TB", *H264, "-c:a", "aac"]),
    ("MP4, cover before the video", "cover.mp4", ["-i", "IN/cover.jpg", "-i", "IN/vfr.mp4", "-map", "1", "-map", "2", "-c", "copy"]),
    ("MP4, HEVC, variable rate", "hevc.mp4", [*VARIABLE, *HEVC]),
    ("MP4, HEVC, turned by 180 degrees", "hevc180.mp4", ["-i", "IN/hevc.mp4", "-map", "1", "-c", "copy", "-metadata:s:v", "rotate=180"]),
    ("MP4, AV1, variable rate", "av1.mp4", [*VARIABLE, *AV1]),
    ("MP4, VP9, variable rate", "vp9.mp4", [*VARIABLE, *VP9]),
    ("MP4, MPEG-4, variable rate", "mpeg4.mp4", [*VARIABLE, *MPEG4]),
    ("MP4, Motion JPEG", "mjpeg.mp4", [*VARIABLE, "-c:v", "mjpeg", "-q:v", "3"]),
    ("QuickTime, H.264, 600 ticks", "ticks.mov", ["-i", "IN/vfr.mp4", "-map", "1", "-c", "copy", "-video_track_timescale", "600"]),
    ("QuickTime, ProRes", "prores.mov", [*VARIABLE, "-c:v", "prores_ks"]),
    ("QuickTime, DV, pixels 64:45", "dv.mov", ["-vf", "scale=720:576,setsar=64/45", *DV]),
    ("QuickTime, PNG", "png.mov", [*VARIABLE, "-c:v", "png"]),
    ("3GP, H.263", "h263.3gp", ["-s", "176x144", "-c:v", "h263"]),
    ("Matroska, H.264, variable rate", "vfr.mkv", [*VARIABLE, *H264]),
    ("Matroska, H.264, starts at 5 s", "late.mkv", ["-i", "IN/vfr.mkv", "-map", "1", "-c", "copy", "-output_ts_offset", "5"]),
    ("Matroska, H.264, pixels 64:45", "wide.mkv", ["-vf", "setsar=64/45," + VARIABLE[1], *VARIABLE[2:], *H264]),
    ("Matroska, cover before the video", "cover.mkv", ["-i", "IN/cover.jpg", "-i", "IN/vfr.mp4", "-map", "1", "-map", "2", "-c", "copy"]),
    ("Matroska, HEVC, variable rate", "hevc.mkv", [*VARIABLE, *HEVC]),
    ("Matroska, FFV1, variable rate", "ffv1.mkv", [*VARIABLE, "-c:v", "ffv1"]),
    ("Matroska, MPEG-4, sound first", "sound.mkv", [*SOUND, "-map", "1", "-map", "0", *MPEG4, "-c:a", "flac"]),
    ("WebM, VP8, variable rate", "vp8.webm", [*VARIABLE, *VP8]),
    ("WebM, VP9, variable rate", "vp9.webm", [*VARIABLE, *VP9]),
    ("WebM, VP9, pixels 10:11", "narrow.webm", [*shape("10/11"), *VP9]),
    ("WebM, AV1, variable rate", "av1.webm", [*VARIABLE, *AV1]),
    ("AVI, MPEG-4 with B-frames", "mpeg4.avi", MPEG4),
    ("AVI, H.264", "h264.avi", H264),
    ("AVI, Motion JPEG", "mjpeg.avi", ["-c:v", "mjpeg", "-q:v", "3"]),
    ("AVI, HuffYUV", "huffyuv.avi", ["-c:v", "huffyuv"]),
    ("AVI, DV, pixels 16:15", "dv.avi", ["-vf", "scale=720:576,setsar=16/15", *DV]),
    ("MPEG-TS, H.264, variable rate", "h264.ts", [*VARIABLE, *H264]),
    ("MPEG-TS, HEVC", "hevc.ts", HEVC),
    ("MPEG-TS, MPEG-2, pixels 4:3", "mpeg2.ts", [*shape("4/3"), *MPEG2]),
    ("M2TS, H.264", "h264.m2ts", H264),
    ("MPEG-PS, MPEG-1", "mpeg1.mpg", ["-c:v", "mpeg1video", "-q:v", "3"]),
    ("VOB, MPEG-2, pixels 4:3", "dvd.vob", [*shape("4/3"), *MPEG2]),
    ("Flash, Sorenson", "flv1.flv", [*VARIABLE, "-c:v", "flv1", "-q:v", "3"]),
    ("Flash, H.264, variable rate", "h264.flv", [*VARIABLE, *H264]),
    ("Ogg, Theora", "theora.ogv", ["-c:v", "libtheora", "-q:v", "7"]),
    ("ASF, WMV 2, variable rate", "wmv2.wmv", [*VARIABLE, "-c:v", "wmv2", "-q:v", "3"]),
    ("ASF, MPEG-4 v3", "msmpeg4.asf", ["-c:v", "msmpeg4", "-q:v", "3"]),
    ("MXF, MPEG-2", "mpeg2.mxf", MPEG2),
    ("NUT, H.264, variable rate", "h264.nut", [*VARIABLE, *H264]),
    ("GIF, variable rate", "a.gif", VARIABLE),
    ("Animated PNG, variable rate", "a.apng", VARIABLE),
    ("Animated PNG with the ending png", "b.png", ["-i", "IN/a.apng", "-map", "1", "-c", "copy", "-f", "apng"]),
    ("IVF, VP9", "vp9.ivf", VP9),
    ("yuv4mpeg", "a.y4m", []),
    ("yuv4mpeg, pixels 64:45", "wide.y4m", shape("64/45")),
    ("DV, pixels 16:15", "a.dv", ["-vf", "scale=720:576,setsar=16/15", *DV]),
    ("H.264 alone", "a.h264", H264),
    ("HEVC alone", "a.hevc", HEVC),
    ("Motion JPEG alone", "a.mjpeg", ["-c:v", "mjpeg", "-q:v", "3"]),
    ("MPEG-TS, two recordings in one file", "twice.ts", ["APPEND", "h264.ts", "h264.ts"]),
    ("MPEG-TS, the size changes", "resized.ts", ["APPEND", "h264.ts", "dv.ts"]),
    ("Matroska, MPEG-4, 100 bytes are zeros", "damaged.mkv", ["DAMAGE", "sound.mkv"]),
    ("MP4, 100 bytes are zeros", "damaged.mp4", ["DAMAGE", "vfr.mp4"]),
    ("MP3", "a.mp3", [*SOUND, "-map", "1"]),
    ("MP4 with sound alone", "a.m4a", [*SOUND, "-map", "1"]),
    ("Ogg with sound alone", "a.ogg", [*SOUND, "-map", "1", "-c:a", "libvorbis"]),
]
# Made for others, not judged.
PARTS: list[tuple[str, list[str]]] = [
    ("narrow0.mp4", [*shape("8/9"), *H264]),
    ("cover.jpg", ["-frames:v", "1"]),
    ("dv.ts", ["-s", "200x150", *H264]),
]


def make(folder: Path, name: str, options: list[str]) -> bool:
    path = folder / name
    if options[:1] == ["APPEND"]:
        path.write_bytes(b"".join((folder / part).read_bytes() for part in options[1:]))
        return True
    if options[:1] == ["DAMAGE"]:
        whole = bytearray((folder / options[1]).read_bytes())
        at = len(whole) // 2
        whole[at : at + 100] = bytes(100)
        path.write_bytes(whole)
        return True
    source = ["-f", "lavfi", "-i", "testsrc2=size=160x120:rate=25:duration=2"]
    options = [option.replace("IN/", f"{folder}/") for option in options]
    made = subprocess.run(["ffmpeg", "-v", "error", "-y", *source, *options, str(path)], capture_output=True, text=True)
    if made.returncode and "fps_mode" in made.stderr:
        options = ["-vsync" if option == "-fps_mode" else option for option in options]
        made = subprocess.run(["ffmpeg", "-v", "error", "-y", *source, *options, str(path)], capture_output=True, text=True)
    return made.returncode == 0


def stream_of(path: Path) -> dict:
    """The video stream that players take: no cover."""
    entries = "stream=index,codec_name,width,height,sample_aspect_ratio,r_frame_rate,avg_frame_rate,nb_frames:stream_disposition=attached_pic"
    found = subprocess.run(
        ["ffprobe", "-v", "error", "-select_streams", "v", "-show_entries", f"{entries}:stream_side_data=rotation", "-of", "json", str(path)],
        capture_output=True, text=True,
    )
    streams = json.loads(found.stdout or "{}").get("streams", [])
    real = [s for s in streams if not s.get("disposition", {}).get("attached_pic")]
    real.sort(key=lambda s: s["codec_name"] in ("mjpeg", "png") and len(streams) > 1)
    return real[0] if real else {}


def times_of(path: Path, index: int) -> list[float | None]:
    found = subprocess.run(
        ["ffprobe", "-v", "error", "-select_streams", str(index), "-show_entries", "frame=best_effort_timestamp_time", "-of", "json", str(path)],
        capture_output=True, text=True,
    )
    stamps = [frame.get("best_effort_timestamp_time") for frame in json.loads(found.stdout)["frames"]]
    return [None if stamp in (None, "N/A") else float(stamp) for stamp in stamps]


def shown(stream: dict) -> tuple[int, int, str]:
    """Sides as players show them, and the shape of a stored pixel."""
    width, height, ratio = stream["width"], stream["height"], stream.get("sample_aspect_ratio", "1:1")
    across, down = (int(n) for n in ratio.split(":")) if ratio not in ("N/A", "0:1") else (1, 1)
    if across > down:
        width = (2 * width * across + down) // (2 * down)
    else:
        height = (2 * height * down + across) // (2 * across)
    turns = [side.get("rotation", 0) for side in stream.get("side_data_list", [])]
    if any(turn % 180 for turn in turns):
        width, height = height, width
    return width, height, f"{across}:{down}"


def thumbnail(path: Path, index: int, part: str = "") -> bytes:
    """The first picture as players turn it, as 16 x 16 grey pixels."""
    found = subprocess.run(
        ["ffmpeg", "-v", "error", "-i", str(path), "-map", f"0:{index}", "-frames:v", "1", "-vf", f"{part}scale=16:16:flags=area,format=gray", "-f", "rawvideo", "-"],
        capture_output=True,
    )
    return found.stdout


def judge(program: str, path: Path, out: Path) -> tuple[str, str, dict]:
    run = subprocess.run(
        [program, "track", str(path), "--init", "40,30,40,40", "--no-report", "--threads", "1", "--json", "--out", str(out)],
        capture_output=True, text=True,
    )
    said = " ".join(run.stderr.split())
    stream = stream_of(path)
    if run.returncode:
        kept = f"{len(list(csv.DictReader((out / 'track.csv').open())))} frames, then: " if (out / "track.csv").exists() else ""
        reason = said.split(f"{path.name}", 1)[-1].lstrip(":, ")
        return "refused", kept + reason, stream and {"size": shown(stream)}
    warned = " ".join(json.loads(run.stdout).get("warnings", []))
    times = [float(row["time"]) for row in csv.DictReader((out / "track.csv").open())]
    wanted = times_of(path, stream["index"])
    if all(stamp is None for stamp in wanted):
        over, under = (int(n) for n in stream["r_frame_rate"].split("/"))
        wanted = [i * under / over for i in range(len(wanted))]
    # Of the last frames of AVI with B-frames ffprobe reports none.
    wanted = [None if stamp is None else stamp - wanted[0] for stamp in wanted]
    played = times_of(out / "annotated.mp4", 0)
    # The picture on the left, a map on the right.
    look = out / "look.png"
    subprocess.run([program, "look", str(path), "--map", "saliency", "--frame", "1", "--most", "0", "--out", str(look)], capture_output=True)
    drawn = stream_of(look)
    width, height, ratio = shown(stream)
    off = max((abs(a - b) for a, b in zip(times, wanted) if b is not None), default=0.0)
    film_off = max((abs(a - played[0] - b) for a, b in zip(played, wanted) if b is not None), default=0.0)
    a, b = thumbnail(path, stream["index"]), thumbnail(look, 0, "crop=iw/2:ih:0:0,")
    differ = sum(abs(x - y) for x, y in zip(a, b)) / max(len(a), 1)
    figures = {
        "frames": (len(times), len(wanted)), "off": off, "film": film_off, "size": (width, height, ratio),
    }
    found = (drawn["width"] // 2, drawn["height"])
    wrong = [
        what
        for what, is_wrong in [
            (f"{len(times)} frames for {len(wanted)}", len(times) != len(wanted)),
            (f"times are off by {off:.6f} s", off > 2e-6),
            (f"times of annotated.mp4 are off by {film_off:.6f} s", film_off > 3e-6),
            (f"pictures are {found[0]} x {found[1]}", found != (width, height)),
            (f"pictures differ by {differ:.1f}: not upright", differ > 12),
        ]
        if is_wrong
    ]
    if warned:
        return "said", warned, figures
    return ("WRONG", "; ".join(wrong), figures) if wrong else ("equal", "", figures)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--foveate", default="target/debug/foveate")
    parser.add_argument("--only", default="", help="kinds whose name or file has this text")
    parser.add_argument("--keep", help="a folder for the videos and results")
    args = parser.parse_args()
    folder = Path(args.keep or tempfile.mkdtemp(prefix="containers-")).resolve()
    folder.mkdir(exist_ok=True)
    for name, options in PARTS:
        make(folder, name, options)
    counts: dict[str, int] = {}
    print("| video | frames | largest difference of a time, annotated.mp4's, s | size shown, stored pixel | result |")
    print("| --- | --- | --- | --- | --- |")
    for name, file, options in KINDS:
        if not make(folder, file, options):
            print(f"| {name} | | | | not made: this ffmpeg cannot |")
            continue
        if args.only not in name and args.only not in file:
            continue
        verdict, why, about = judge(args.foveate, folder / file, folder / f"out-{file}")
        counts[verdict] = counts.get(verdict, 0) + 1
        frames = "{} of {}".format(*about["frames"]) if "frames" in about else ""
        off = f"{about['off']:.6f}, {about['film']:.6f}" if "off" in about else ""
        size = "{} x {}, {}".format(*about["size"]) if about.get("size") else ""
        print(f"| {name} | {frames} | {off} | {size} | {verdict}{': ' + why if why else ''} |", flush=True)
    print("\n" + ", ".join(f"{count} {verdict}" for verdict, count in sorted(counts.items())))
    return 1 if counts.get("WRONG") else 0


if __name__ == "__main__":
    sys.exit(main())

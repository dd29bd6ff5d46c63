"""Files of `foveate convert` and `foveate annotate`, opened by the packages whose formats they have, and their files read by foveate.

A test without its package is skipped with a reason. `FOVEATE` names the program, `FOVEATE_DATA` the folder with `mot/`.
"""

from __future__ import annotations

import json
import os
import subprocess
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from test_clients import drawn, need, program, truth  # noqa: F401, the fixture `program`

ROOT = Path(__file__).resolve().parents[2]
Box = tuple[float, float, float, float]
# Datumaro rounds corners to a hundredth of a pixel, so that a side may differ by as much.
HUNDREDTH = 0.0101


@dataclass
class Tracks:
    """Boxes of targets, `x, y, w, h` from 0, by target and frame from 0."""

    boxes: dict[int, dict[int, Box]]
    frames: int
    size: tuple[int, int]
    occluded: set[tuple[int, int]] = field(default_factory=set)

    def label(self, target: int) -> str:
        return "person, \"walking\" & co" if target % 2 else "car"

    def same(self, boxes: dict[int, dict[int, Box]], within: float) -> None:
        assert {t: sorted(track) for t, track in boxes.items()} == {t: sorted(track) for t, track in self.boxes.items()}
        for target, track in self.boxes.items():
            for frame, box in track.items():
                assert boxes[target][frame] == pytest.approx(box, abs=within), (target, frame)

    def task(self) -> str:
        """As CVAT for video exports them."""
        names = sorted({self.label(target) for target in self.boxes})
        text = [f"<annotations><version>1.1</version><meta><task><size>{self.frames}</size><mode>interpolation</mode><labels>"]
        text += [f"<label><name>{escaped(name)}</name><attributes></attributes></label>" for name in names]
        text += ["</labels><original_size><width>{}</width><height>{}</height></original_size></task></meta>".format(*self.size)]
        for target, track in self.boxes.items():
            text.append(f'<track id="{target}" label="{escaped(self.label(target))}" source="manual">')
            for frame, (x, y, w, h) in sorted(track.items()):
                shape = f'xtl="{x}" ytl="{y}" xbr="{x + w}" ybr="{y + h}" z_order="0"'
                hidden = int((target, frame) in self.occluded)
                text.append(f'<box frame="{frame}" keyframe="1" outside="0" occluded="{hidden}" {shape}></box>')
                if frame + 1 not in track and frame + 1 < self.frames:
                    text.append(f'<box frame="{frame + 1}" keyframe="1" outside="1" occluded="{hidden}" {shape}></box>')
            text.append("</track>")
        return "\n".join([*text, "</annotations>\n"])


def escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace('"', "&quot;")


@pytest.fixture(params=["drawn", "TUD-Campus", "PETS09-S2L1", "KITTI-17"])
def tracks(request) -> Tracks:
    """Three targets, of which one is away for a while, or the ground truth of a real video, with a gap and occlusion added."""
    if request.param == "drawn":
        boxes = {0: {t: truth(t) for t in range(30)}, 7: {t: (5.25, 6.5 + t, 10.0, 12.75) for t in (*range(3, 9), *range(15, 22))}, 12: {29: (1.0, 2.0, 3.0, 4.0)}}
        return Tracks(boxes, 40, (160, 120), {(7, 5), (7, 6), (0, 29)})
    folder = Path(os.environ.get("FOVEATE_DATA", ROOT / "data")) / "mot" / request.param
    if not folder.is_dir():
        pytest.skip(f"skipped: no folder {folder}")
    boxes: dict[int, dict[int, Box]] = {}
    for line in open(folder / "gt" / "gt.txt"):
        frame, target, x, y, w, h = (float(value) for value in line.split(",")[:6])
        boxes.setdefault(int(target), {})[int(frame) - 1] = (x - 1, y - 1, w, h)
    ends = {target: sorted(track) for target, track in boxes.items()}
    long = max(ends, key=lambda target: len(ends[target]))
    middle = ends[long][len(ends[long]) // 2]
    boxes[long] = {frame: box for frame, box in boxes[long].items() if not middle <= frame < middle + 5}
    about = dict(line.strip().split("=", 1) for line in open(folder / "seqinfo.ini") if "=" in line)
    size = (int(about["imWidth"]), int(about["imHeight"]))
    return Tracks(boxes, int(about["seqLength"]), size, {(long, frame) for frame in ends[long][:9]})


def convert(program: str, source: Path, target: Path, of: str, to: str, size: tuple[int, int]) -> str:
    command = [program, "convert", source, target, "--from", of, "--to", to, "--size", "{}x{}".format(*size)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stderr


def mot(path: Path) -> dict[int, dict[int, Box]]:
    boxes: dict[int, dict[int, Box]] = {}
    for line in open(path):
        frame, target, x, y, w, h = (float(value) for value in line.split(",")[:6])
        boxes.setdefault(int(target), {})[int(frame) - 1] = (x - 1, y - 1, w, h)
    return boxes


def read_back(program: str, path: Path, of: str, size: tuple[int, int]) -> dict[int, dict[int, Box]]:
    """The boxes that foveate reads."""
    out = path.with_suffix(".mot.txt")
    convert(program, path, out, of, "mot", size)
    return mot(out)


def test_cvat_is_what_datumaro_reads_and_writes(program: str, tracks: Tracks, tmp_path: Path) -> None:
    dm, annotation, media = need("datumaro", "datumaro.components.annotation", "datumaro.components.media")
    (tmp_path / "task.xml").write_text(tracks.task())
    (tmp_path / "cvat").mkdir()
    lost = convert(program, tmp_path / "task.xml", tmp_path / "cvat" / "boxes.xml", "cvat", "cvat", tracks.size)
    assert lost == ""
    data = dm.Dataset.import_from(str(tmp_path / "cvat"), "cvat")
    names = data.categories()[annotation.AnnotationType.label]
    boxes: dict[int, dict[int, Box]] = {}
    for item in data:
        for a in item.annotations:
            target, frame = a.attributes["track_id"], item.attributes["frame"]
            assert a.attributes["keyframe"] and names[a.label].name == tracks.label(target)
            if a.attributes["outside"]:
                assert frame not in tracks.boxes[target] and frame - 1 in tracks.boxes[target]
                continue
            assert a.attributes["occluded"] == ((target, frame) in tracks.occluded)
            boxes.setdefault(target, {})[frame] = tuple(a.get_bbox())
    tracks.same(boxes, HUNDREDTH)
    # Datumaro reads the size of the pictures.
    for item in data:
        item.media = media.Image.from_file(path=item.media.path, size=tracks.size[::-1])
    data.export(str(tmp_path / "theirs"), "cvat", use_track=True, save_media=False)
    (written,) = (tmp_path / "theirs").glob("*.xml")
    tracks.same(read_back(program, written, "cvat", tracks.size), HUNDREDTH)
    convert(program, written, tmp_path / "again.xml", "cvat", "cvat", tracks.size)
    again = (tmp_path / "again.xml").read_text()
    assert again.count('outside="0" occluded="1"') == len(tracks.occluded)
    for target in tracks.boxes:
        assert f'<track id="{target}" label="{escaped(tracks.label(target))}"' in again


def test_mot_is_what_datumaro_reads_and_writes(program: str, tracks: Tracks, tmp_path: Path) -> None:
    dm = need("datumaro")
    # Datumaro's writer numbers the targets by their first appearance, and MOTChallenge has no target 0.
    order = sorted(tracks.boxes, key=lambda target: (min(tracks.boxes[target]), target))
    tracks = Tracks({n: tracks.boxes[target] for n, target in enumerate(order, 1)}, tracks.frames, tracks.size)
    (tmp_path / "task.xml").write_text(tracks.task())
    (tmp_path / "mot" / "gt").mkdir(parents=True)
    convert(program, tmp_path / "task.xml", tmp_path / "mot" / "gt" / "gt.txt", "cvat", "mot", tracks.size)
    data = dm.Dataset.import_from(str(tmp_path / "mot"), "mot_seq")
    boxes: dict[int, dict[int, Box]] = {}
    for item in data:
        for a in item.annotations:
            x, y, w, h = a.get_bbox()
            boxes.setdefault(a.attributes["track_id"], {})[int(item.id) - 1] = (x - 1, y - 1, w, h)
    tracks.same(boxes, HUNDREDTH)
    data.export(str(tmp_path / "theirs"), "mot_seq_gt", save_media=False)
    tracks.same(read_back(program, tmp_path / "theirs" / "gt" / "gt.txt", "mot", tracks.size), HUNDREDTH)


def test_coco_is_what_kwcoco_reads_and_writes(program: str, tracks: Tracks, tmp_path: Path) -> None:
    kwcoco = need("kwcoco")
    (tmp_path / "task.xml").write_text(tracks.task())
    convert(program, tmp_path / "task.xml", tmp_path / "boxes.json", "cvat", "coco", tracks.size)
    data = kwcoco.CocoDataset(str(tmp_path / "boxes.json"))
    boxes: dict[int, dict[int, Box]] = {}
    for a in data.annots().objs:
        assert data.cats[a["category_id"]]["name"] == tracks.label(a["track_id"])
        boxes.setdefault(a["track_id"], {})[data.imgs[a["image_id"]]["frame_id"] - 1] = tuple(a["bbox"])
    tracks.same(boxes, 1e-9)
    assert data.n_images == tracks.frames
    data.dump(str(tmp_path / "theirs.json"))
    tracks.same(read_back(program, tmp_path / "theirs.json", "coco", tracks.size), 1e-9)
    convert(program, tmp_path / "theirs.json", tmp_path / "again.xml", "coco", "cvat", tracks.size)
    again = (tmp_path / "again.xml").read_text()
    assert all(f'id="{target}" label="{escaped(tracks.label(target))}"' in again for target in tracks.boxes)


CONFIG = """<View><Video name="video" value="$video"/><VideoRectangle name="box" toName="video"/>
<Labels name="videoLabels" toName="video"><Label value="car"/></Labels></View>"""


def frames_of(video, regions: list, size: tuple[int, int]) -> dict[int, dict[int, Box]]:
    """Boxes of all frames, as Label Studio interpolates them for an export; targets count from 1."""
    boxes: dict[int, dict[int, Box]] = {}
    for target, region in enumerate(video.extract_key_frames(regions), 1):
        for key in region["value"]["sequence"]:
            box = [key[name] * size[k % 2] / 100 for k, name in enumerate(("x", "y", "width", "height"))]
            boxes.setdefault(target, {})[key["frame"] - 1] = tuple(box)
    return boxes


def test_label_studio_is_what_its_sdk_reads_and_writes(program: str, tracks: Tracks, tmp_path: Path) -> None:
    interface, video = need("label_studio_sdk.label_interface", "label_studio_sdk._extensions.label_studio_tools.postprocessing.video")
    (tmp_path / "task.xml").write_text(tracks.task())
    convert(program, tmp_path / "task.xml", tmp_path / "tasks.json", "cvat", "label-studio", tracks.size)
    (task,) = json.loads((tmp_path / "tasks.json").read_text())
    (prediction,) = task["predictions"]
    errors = interface.LabelInterface(CONFIG).validate_prediction(prediction, return_errors=True)
    assert errors == []
    ids = [int(region["id"].removeprefix("target-")) for region in prediction["result"]]
    boxes = frames_of(video, prediction["result"], tracks.size)
    tracks.same({ids[n - 1]: track for n, track in boxes.items()}, 1e-9)
    assert [region["value"]["labels"] for region in prediction["result"]] == [[tracks.label(target)] for target in ids]
    # What its export with interpolated frames makes of the file.
    exported = [{"data": task["data"], "annotations": [{"result": video.extract_key_frames(prediction["result"])}]}]
    (tmp_path / "theirs.json").write_text(json.dumps(exported))
    tracks.same(read_back(program, tmp_path / "theirs.json", "label-studio", tracks.size), 1e-9)
    convert(program, tmp_path / "theirs.json", tmp_path / "again.json", "label-studio", "label-studio", tracks.size)
    (again,) = json.loads((tmp_path / "again.json").read_text())
    assert frames_of(video, again["predictions"][0]["result"], tracks.size).keys() == boxes.keys()


def annotated() -> list:
    """Two targets as a person draws them: the first moves, leaves and comes back, the second stays to the end of the video."""
    key = lambda frame, x, enabled=True: {"frame": frame, "time": frame / 24, "enabled": enabled, "rotation": 0, "x": x, "y": 25.0, "width": 15.0, "height": 20.0}
    region = lambda name, *keys: {
        "id": name, "type": "videorectangle", "from_name": "box", "to_name": "video", "origin": "manual",
        "value": {"framesCount": 30, "duration": 1.25, "labels": ["car"], "sequence": list(keys)},
    }  # fmt: skip
    first = region("hD2cQ", key(1, 25.0), key(5, 32.5), key(9, 40.0, False), key(20, 10.0), key(24, 12.0, False))
    return [first, region("x0Yqf", key(11, 50.0), key(14, 56.0))]


def test_label_studio_and_foveate_interpolate_alike(program: str, tmp_path: Path) -> None:
    video = need("label_studio_sdk._extensions.label_studio_tools.postprocessing.video")
    (tmp_path / "tasks.json").write_text(json.dumps([{"data": {}, "annotations": [{"result": annotated()}]}]))
    theirs = frames_of(video, annotated(), (160, 120))
    Tracks(theirs, 30, (160, 120)).same(read_back(program, tmp_path / "tasks.json", "label-studio", (160, 120)), 1e-9)
    assert max(theirs[2]) == 29 and 8 in theirs[1] and 9 not in theirs[1]


def test_label_studio_opens_an_annotated_video(program: str, tmp_path: Path) -> None:
    interface, video, image = need("label_studio_sdk.label_interface", "label_studio_sdk._extensions.label_studio_tools.postprocessing.video", "PIL.Image")
    (tmp_path / "img").mkdir()
    for t in range(12):
        image.fromarray(drawn(t)).save(tmp_path / "img" / f"{t + 1:04d}.png")
    keys = [annotated()[0]]
    keys[0]["value"]["framesCount"] = 12
    keys[0]["value"]["sequence"] = [{**keys[0]["value"]["sequence"][0], "frame": t + 1, "x": truth(t)[0] / 1.6, "y": truth(t)[1] / 1.2, "width": 15.0, "height": 20.0} for t in (0, 11)]
    (tmp_path / "tasks.json").write_text(json.dumps([{"data": {}, "annotations": [{"result": keys}]}]))
    command = [program, "annotate", "img", "--keyframes", "tasks.json", "--format", "label-studio", "--config", "digits", "--out", "out"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (task,) = json.loads((tmp_path / "out" / "boxes.json").read_text())
    assert interface.LabelInterface(CONFIG).validate_prediction(task["predictions"][0], return_errors=True) == []
    (track,) = frames_of(video, task["predictions"][0]["result"], (160, 120)).values()
    assert sorted(track) == list(range(12))
    for t, box in track.items():
        assert box == pytest.approx(truth(t), abs=1e-9 if t in (0, 11) else 3), t


def test_viame_is_what_dive_reads_and_writes(program: str, tracks: Tracks, tmp_path: Path) -> None:
    viame = need("dive_utils.serializers.viame")
    (tmp_path / "task.xml").write_text(tracks.task())
    convert(program, tmp_path / "task.xml", tmp_path / "tracks.csv", "cvat", "viame", tracks.size)
    data, _ = viame.load_csv_as_tracks_and_attributes((tmp_path / "tracks.csv").read_text().splitlines(True))
    boxes: dict[int, dict[int, Box]] = {}
    for track in data["tracks"].values():
        assert [tuple(pair) for pair in track["confidencePairs"]] == [(tracks.label(track["id"]), 1.0)]
        for feature in track["features"]:
            left, top, right, bottom = feature["bounds"]
            boxes.setdefault(track["id"], {})[feature["frame"]] = (left, top, right - left, bottom - top)
    # DIVE rounds to whole pixels.
    tracks.same(boxes, 1.0)
    # A second class that is less sure, names of pictures with a comma, and attributes.
    for track in data["tracks"].values():
        track["confidencePairs"] = [("other", 0.1), *track["confidencePairs"]]
        track["attributes"] = {"note": "a, b"}
    names = [f"{t}, left.png" for t in range(tracks.frames)]
    text = "".join(viame.export_tracks_as_csv(data["tracks"].values(), filenames=names))
    (tmp_path / "theirs.csv").write_text(text)
    Tracks(boxes, tracks.frames, tracks.size).same(read_back(program, tmp_path / "theirs.csv", "viame", tracks.size), 1e-9)
    convert(program, tmp_path / "theirs.csv", tmp_path / "again.xml", "viame", "cvat", tracks.size)
    again = (tmp_path / "again.xml").read_text()
    assert all(f'id="{target}" label="{escaped(tracks.label(target))}"' in again for target in boxes)


def test_spots_are_those_that_sleap_reads_of_trackmate(program: str, tracks: Tracks, tmp_path: Path) -> None:
    trackmate = need("sleap_io.io.trackmate")
    (tmp_path / "task.xml").write_text(tracks.task())
    convert(program, tmp_path / "task.xml", tmp_path / "tracks_spots.csv", "cvat", "trackmate", tracks.size)
    labels = trackmate.read_trackmate_csv(tmp_path / "tracks_spots.csv")
    found = {(spot.track.name, frame.frame_idx): (spot.x, spot.y) for frame in labels for spot in frame.centroids}
    middles = {(f"Track_{t}", at): (x + (w - 1) / 2, y + (h - 1) / 2) for t, track in tracks.boxes.items() for at, (x, y, w, h) in track.items()}
    assert found.keys() == middles.keys()
    for spot, middle in middles.items():
        assert found[spot] == pytest.approx(middle, abs=1e-9), spot
    # Squares of the same area, about the same centres.
    square = {
        t: {at: (x + (w - (w * h) ** 0.5) / 2, y + (h - (w * h) ** 0.5) / 2, (w * h) ** 0.5, (w * h) ** 0.5) for at, (x, y, w, h) in track.items()}
        for t, track in tracks.boxes.items()
    }
    Tracks(square, tracks.frames, tracks.size).same(read_back(program, tmp_path / "tracks_spots.csv", "trackmate", tracks.size), 1e-9)


def test_shapes_are_those_that_napari_reads_and_writes(program: str, tracks: Tracks, tmp_path: Path) -> None:
    reading, writing = need("napari_builtins.io._read", "napari_builtins.io._write")
    (tmp_path / "task.xml").write_text(tracks.task())
    target = max(tracks.boxes, key=lambda target: len(tracks.boxes[target]))
    one = Tracks({1: tracks.boxes[target]}, tracks.frames, tracks.size)
    command = [program, "convert", tmp_path / "task.xml", tmp_path / "shapes.csv", "--from", "cvat", "--to", "napari", "--id", str(target)]
    subprocess.run(command, check=True, capture_output=True)
    data, about, kind = reading.csv_to_layer_data(str(tmp_path / "shapes.csv"), require_type="shapes")
    assert kind == "shapes" and set(about["shape_type"]) == {"rectangle"}
    found = {}
    for corners in data:
        (t, top, left), (_, bottom, right) = corners.min(0), corners.max(0)
        found[int(t)] = (left + 0.5, top + 0.5, right - left, bottom - top)
    one.same({1: found}, 1e-9)
    writing.napari_write_shapes(str(tmp_path / "theirs.csv"), data, about)
    one.same(read_back(program, tmp_path / "theirs.csv", "napari", tracks.size), 1e-9)

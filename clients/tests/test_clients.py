"""Every client against the real package; without that the test is skipped with a reason.

`FOVEATE` names the program; else it is looked for in PATH.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

np = pytest.importorskip("numpy")
CLIENTS = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(CLIENTS))

FIRST = (40.0, 30.0, 24.0, 24.0)


def need(*names: str):
    """The packages; skips the test where one is missing."""
    found = [pytest.importorskip(name, reason=f"skipped: no package {name}", exc_type=ImportError) for name in names]
    return found[0] if len(found) == 1 else found


def drawn(t: int) -> np.ndarray:
    """A textured square on texture, that moves by 3 and 1 pixels a frame."""
    rng = np.random.default_rng(7)
    image = rng.integers(0, 60, (120, 160, 3)).astype(np.uint8)
    x, y = 40 + 3 * t, 30 + t
    image[y : y + 24, x : x + 24] = rng.integers(100, 256, (24, 24, 3)).astype(np.uint8)
    return image


def truth(t: int) -> tuple[float, float, float, float]:
    return (40.0 + 3 * t, 30.0 + t, 24.0, 24.0)


@pytest.fixture(scope="session")
def program() -> str:
    found = os.environ.get("FOVEATE") or shutil.which("foveate")
    if not found:
        pytest.skip("skipped: no program foveate in PATH, and no variable FOVEATE")
    return found


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two sequences in OTB's layout."""
    PIL = need("PIL.Image")
    for name, step in (("a", 1), ("b", 2)):
        images = tmp_path / "seqs" / name / "img"
        images.mkdir(parents=True)
        frames = range(0, 20, step)
        for i, t in enumerate(frames, 1):
            PIL.fromarray(drawn(t)).save(images / f"{i:04d}.png")
        lines = [f"{x + 1},{y + 1},{w},{h}\n" for x, y, w, h in map(truth, frames)]
        (tmp_path / "seqs" / name / "groundtruth_rect.txt").write_text("".join(lines))
    return tmp_path / "seqs"


@pytest.mark.parametrize("shape", ["polygon", "mask"])
@pytest.mark.parametrize("several", [False, True])
def test_trax(program: str, folder: Path, several: bool, shape: str) -> None:
    trax, client_of = need("trax", "trax.client")
    command = [program, "trax", "--profile", "fast"] + ["--objects"] * several
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0) as process:
        client = client_of.Client(stream=(process.stdin.fileno(), process.stdout.fileno()), log=lambda _: None)
        assert client.tracker_name == "foveate" and bool(client.get("multiobject")) is several
        picture = lambda t: {"color": trax.FileImage.create(str(folder / "a" / "img" / f"{t + 1:04d}.png"))}
        x, y, w, h = FIRST
        square = trax.Polygon.create([(x, y), (x + w, y), (x + w, y + h), (x, y + h)])
        if shape == "mask":
            # Its corners are no pixels of the target; the box about it is the same.
            pixels = np.pad(np.ones((int(h), int(w)), np.uint8), 2)
            pixels[2, 2] = pixels[-3, -3] = 0
            square = trax.Mask.create(pixels, int(x) - 2, int(y) - 2)
        objects = [(square, {})] + [(trax.Rectangle.create(5, 70, 20, 20), {})] * several
        answers, _ = client.initialize(picture(0), objects, {})
        assert answers[0][0].bounds() == FIRST
        for t in range(1, 10):
            answers, _ = client.frame(picture(t), {}, [])
            assert len(answers) == len(objects)
            (region, properties) = answers[0]
            assert np.allclose(region.bounds(), truth(t), atol=3), (t, region.bounds())
            assert 0.0 <= float(properties.get("confidence")) <= 1.0
        client.quit()
        assert process.wait(timeout=20) == 0


def test_csrt(folder: Path) -> None:
    trax, client_of, cv2 = need("trax", "trax.client", "cv2")
    if not hasattr(cv2, "TrackerCSRT_create"):
        pytest.skip("skipped: opencv-python has no CSRT, opencv-contrib-python has")
    command = [sys.executable, str(CLIENTS / "csrt_trax.py")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0) as process:
        client = client_of.Client(stream=(process.stdin.fileno(), process.stdout.fileno()), log=lambda _: None)
        picture = lambda t: {"color": trax.FileImage.create(str(folder / "a" / "img" / f"{t + 1:04d}.png"))}
        client.initialize(picture(0), [(trax.Rectangle.create(*FIRST), {})], {})
        for t in range(1, 6):
            answers, _ = client.frame(picture(t), {}, [])
            assert np.allclose(answers[0][0].bounds(), truth(t), atol=6), t
        client.quit()
        assert process.wait(timeout=20) == 0


def test_csrt_names_the_package_it_needs(tmp_path: Path) -> None:
    need("trax")
    (tmp_path / "cv2.py").write_text("__version__ = '5.0.0'\n")
    command = [sys.executable, str(CLIENTS / "csrt_trax.py")]
    done = subprocess.run(command, env={**os.environ, "PYTHONPATH": str(tmp_path)}, capture_output=True, text=True)
    assert done.returncode == 1 and "pip install opencv-contrib-python" in done.stderr, done.stderr


@pytest.fixture
def numbered(tmp_path: Path) -> Path:
    """120 pictures, 1.png to 120.png, as bright as their numbers; the target is away in 51 to 53 and from 101 on."""
    cv2 = need("cv2")
    (tmp_path / "seqs" / "a" / "img").mkdir(parents=True)
    lines = ["NaN,NaN,NaN,NaN\n" if 51 <= n <= 53 else "0,0,0,0\n" if n > 100 else "2,2,4,4\n" for n in range(1, 121)]
    for n in range(1, 121):
        cv2.imwrite(str(tmp_path / "seqs" / "a" / "img" / f"{n}.png"), np.full((8, 8, 3), n, np.uint8))
    (tmp_path / "seqs" / "a" / "groundtruth_rect.txt").write_text("".join(lines))
    return tmp_path / "seqs" / "a"


def test_a_workspace_has_anchors_with_a_target(numbered: Path, tmp_path: Path) -> None:
    import vot_workspace

    vot_workspace.add(numbered, tmp_path / "a")
    anchors = (tmp_path / "a" / "anchor.value").read_text().split()
    assert {n: anchor for n, anchor in enumerate(anchors, 1) if anchor != "0"} == {1: "1", 54: "1"}


def test_pictures_come_in_the_order_of_their_numbers(numbered: Path, tmp_path: Path) -> None:
    import otb_pictures
    import vot_workspace

    assert [path.name for path in otb_pictures.pictures(numbered)] == [f"{n}.png" for n in range(1, 121)]
    vot_workspace.add(numbered, tmp_path / "a")
    mean = lambda n: need("cv2").imread(str(tmp_path / "a" / "color" / f"{n:08d}.jpg")).mean()
    assert all(abs(mean(n) - n) < 3 for n in (1, 2, 10, 99, 100, 120))


def test_got10k_figures_are_those_of_eval(program: str, folder: Path, tmp_path: Path) -> None:
    need("got10k", "foveate")
    import got10k_foveate as client

    out = tmp_path / "out"
    run = client.experiment(folder, out)
    run.run(client.FoveateTracker("fast"))
    theirs = run.report(["foveate"])["foveate"]
    command = [program, "eval", "--json", "--out", str(tmp_path / "eval"), "--seqs", str(folder)]
    done = subprocess.run([*command, "--results", str(out / "results" / "foveate")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    ours = json.loads(done.stdout)["trackers"][0]
    rows = [("overall", ours["mean"], theirs["overall"])]
    rows += [(row["sequence"], row, theirs["seq_wise"][row["sequence"]]) for row in ours["sequences"]]
    assert len(rows) == 3
    for name, own, other in rows:
        for key, theirs_key in (("auc", "success_score"), ("p20", "precision_score"), ("sr50", "success_rate")):
            assert abs(own[key] - other[theirs_key]) < 1e-9, (name, key)
    assert ours["mean"]["auc"] > 0.7


def test_cvat() -> None:
    cvataa, Image, _ = need("cvat_sdk.auto_annotation", "PIL.Image", "foveate")
    import cvat_function

    function = cvat_function.create()
    assert function.spec.supported_shape_types == {"rectangle"}
    x, y, w, h = FIRST
    shape = cvataa.TrackableShape(type="rectangle", points=[x, y, x + w, y + h])
    image = lambda t: function.preprocess_image(None, Image.fromarray(drawn(t)))
    state = function.init_tracking_state(None, image(0), shape)
    tracker = __import__("foveate").Tracker("fast", seed=1)
    tracker.init(drawn(0), FIRST)
    for t in range(1, 8):
        state = json.loads(json.dumps(state))
        found = function.track(None, image(t), state)
        # A tracker that stays in memory gives the same results.
        assert found.type == "rectangle" and tuple(found.points) == tracker.update(drawn(t)).box.xyxy
    noise = np.random.default_rng(1).integers(0, 60, (40, 120, 160, 3)).astype(np.uint8)
    answers = [function.track(None, picture, state) for picture in noise]
    assert answers[-1] is None


def test_supervision() -> None:
    sv, _ = need("supervision", "foveate")
    import supervision_boxes

    pictures = [drawn(t) for t in range(12)]
    found = [sv.Detections(xyxy=np.array([[x, y, x + w, y + h]]), confidence=np.array([0.9])) for x, y, w, h in map(truth, range(12))]
    tracks = supervision_boxes.follow(pictures, found)
    assert len(set(tracks[-1].tracker_id)) == 1 and len(tracks[-1]) == 1
    drawn_on = supervision_boxes.draw(pictures[-1], tracks[-1])
    assert drawn_on.shape == pictures[-1].shape and (drawn_on != pictures[-1]).any()


def tracked(count: int):
    """Results of a tracker, frame by frame."""
    tracker = need("foveate").Tracker("fast")
    tracker.init(drawn(0), FIRST)
    return [(t, drawn(t), tracker.update(drawn(t))) for t in range(1, count)]


def test_norfair() -> None:
    norfair = need("norfair")
    import norfair_points

    tracker = norfair.Tracker(distance_function="euclidean", distance_threshold=40, initialization_delay=1)
    for _, _, seen in tracked(8):
        objects = tracker.update(detections=[norfair_points.detection(seen)])
    assert len(objects) == 1 and np.allclose(objects[0].estimate[0], truth(7)[:2], atol=6)


def test_rerun(tmp_path: Path) -> None:
    rr = need("rerun")
    import rerun_log

    rr.init("foveate-test")
    rr.save(str(tmp_path / "out.rrd"))
    for t, image, seen in tracked(5):
        rerun_log.log(t, image, seen)
    rr.disconnect()
    # Four pictures of noise, which JPEG compresses to less than a third.
    assert 5_000 < (tmp_path / "out.rrd").stat().st_size < 4 * drawn(0).size / 2


def of_eval(program: str, folder: Path) -> dict:
    """The figures of `foveate eval --mot` for drawn tracks, in gt.txt and tracks.txt."""
    rng = np.random.default_rng(3)
    true, found = [], []
    for frame in range(1, 41):
        for target in range(1, 5):
            x, y = 60 * target + frame, 30 * target
            true.append(f"{frame},{target},{x},{y},20,40,1,-1,-1,-1\n")
            # Two of them swap their names; some are missed, some are too far off.
            name = {1: 2, 2: 1}.get(target, target) if frame > 20 else target
            if rng.random() > 0.1:
                found.append(f"{frame},{name},{x + rng.integers(0, 9)},{y},20,40,{target - 1},-1,-1,-1\n")
        # Flags that do not count: 0, and what MOTChallenge truncates to 0.
        true.append(f"{frame},9,{frame},200,20,40,{0.5 * (frame % 2)},-1,-1,-1\n")
    (folder / "gt.txt").write_text("".join(true))
    (folder / "tracks.txt").write_text("".join(found))
    command = [program, "eval", "--mot", "--json", "--truth", "gt.txt", "--results", "tracks.txt", "--out", "out"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)["trackers"][0]["pooled"]


def test_rows_with_a_flag_of_zero_count_in_results_alone(tmp_path: Path) -> None:
    import mot_text

    flags = ["0", "0.9", "1", "-1", "0.0"]
    text = "".join(f"{frame},1,2,3,4,5,{flag},-1,-1,-1\n" for frame, flag in enumerate(flags, 1))
    (tmp_path / "a.txt").write_text(text)
    assert mot_text.rows(str(tmp_path / "a.txt"))[:, 0].tolist() == [1, 2, 3, 4, 5]
    assert mot_text.rows(str(tmp_path / "a.txt"), truth=True)[:, 0].tolist() == [3, 4]


@pytest.mark.parametrize("package", ["motmetrics", "trackeval"])
def test_figures_of_many_targets_are_those_of_eval(program: str, tmp_path: Path, package: str) -> None:
    need(package)
    figures = __import__(f"{package}_figures").figures
    ours = of_eval(program, tmp_path)
    theirs = figures(str(tmp_path / "gt.txt"), str(tmp_path / "tracks.txt"))
    shared = {"motmetrics": ["mota", "idf1"], "trackeval": ["mota", "idf1", "hota", "det_a", "ass_a"]}[package]
    for name in shared:
        assert abs(ours[name] - theirs[name]) < 1e-9, (name, ours, theirs)
    assert theirs["num_switches"] > 0

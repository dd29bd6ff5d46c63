"""One target."""

from __future__ import annotations

import copy
import itertools
import multiprocessing
import pickle
import re
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import FIRST

import foveate


def follow(tracker: foveate.Tracker, pictures: Any, first: Any = FIRST) -> list[foveate.Box]:
    tracker.init(pictures[0], first)
    return [tracker.update(picture).box for picture in pictures[1:]]


def test_a_square_is_followed(pictures: Any) -> None:
    # A configuration without box regression: the box is where the particles are.
    tracker = foveate.Tracker("natural-middle", config={"particles": 300})
    tracker.init(pictures[0], FIRST)
    for t, picture in enumerate(pictures[1:], 1):
        seen = tracker.update(picture)
        ok, box = seen
        assert ok is True and bool(seen) and box == seen.box
        assert abs(box.x - 40 - 3 * t) < 2 and abs(box.y - 30 - t) < 2
        assert seen.status == "tracking" and 0 <= seen.p_lost < 0.5
    n = len(seen.weights)
    assert n == 300 and seen.particles.shape == (n, 7) and seen.covariance.shape == (7, 7)
    mean = (seen.weights[:, None] * seen.particles).sum(axis=0)
    np.testing.assert_allclose(mean[:5], np.array(seen.state)[:5], atol=1e-6)
    np.testing.assert_allclose(seen.weights.sum(), 1)
    np.testing.assert_allclose(seen.ess, 1 / (seen.weights**2).sum())
    assert seen.particles is seen.particles, "made once"
    assert not (seen.particles.flags.writeable or seen.covariance.flags.writeable) and seen.gazes.shape == (len(seen.rewards), 2)
    assert seen.gaze in [tuple(g) for g in seen.gazes.tolist()]
    assert "tracking" in repr(seen)


def test_results_outlive_the_tracker(pictures: Any) -> None:
    tracker = foveate.Tracker(config={"particles": 50})
    tracker.init(pictures[0], FIRST)
    first = tracker.update(pictures[1])
    kept = first.particles.copy()
    for picture in pictures[2:6]:
        tracker.update(picture)
    del tracker
    np.testing.assert_array_equal(first.particles, kept)


def test_results_can_be_copied_and_sent(pictures: Any) -> None:
    tracker = foveate.Tracker("digits-hedge", config={"particles": 50})
    tracker.init(pictures[0], FIRST)
    seen = tracker.update(pictures[1])
    for other in (pickle.loads(pickle.dumps(seen)), copy.copy(seen), copy.deepcopy(seen)):
        for name in ("ok", "box", "p_lost", "status", "state", "ess", "log_evidence", "gaze", "classes"):
            assert getattr(other, name) == getattr(seen, name), name
        for name in ("covariance", "particles", "weights", "gazes", "rewards"):
            np.testing.assert_array_equal(getattr(other, name), getattr(seen, name))
        assert other.region(0.5) == seen.region(0.5) and not other.particles.flags.writeable
    restore, (status, numbers, arrays, classes) = seen._estimate.__reduce__()
    cut = (*arrays[:2], arrays[2][1:, 1:], arrays[3])
    for wrong in (("gone", numbers, arrays, classes), (status, numbers[1:], arrays, classes), (status, numbers, cut, classes)):
        with pytest.raises(foveate.InputError, match="no pickle of a result"):
            restore(*wrong)
    assert len(pickle.loads(pickle.dumps(foveate.Run.of(tracker, pictures[:4], FIRST)))) == 4


def test_regions_grow_with_their_share(pictures: Any) -> None:
    tracker = foveate.Tracker(config={"particles": 100})
    tracker.init(pictures[0], FIRST)
    seen = tracker.update(pictures[1])
    half, most = seen.region(0.5), seen.region(0.99)
    assert half.x == seen.state.x and half.major >= half.minor > 0
    of = [share ** (-2 / 2.5) - 1 for share in (0.01, 0.5)]  # of a Student distribution, with 2.5 degrees of freedom
    np.testing.assert_allclose(most.major / half.major, np.sqrt(of[0] / of[1]))
    assert seen.region() == seen.region(0.9)
    for wrong in (-0.1, 1.0, float("nan")):
        with pytest.raises(foveate.InputError, match="0 to below 1"):
            seen.region(wrong)


def test_every_layout_and_stride_gives_the_same_boxes(pictures: Any) -> None:
    config = {"particles": 60}
    wanted = follow(foveate.Tracker(config=config), pictures)

    def same(channels: Any, change: Any) -> None:
        assert follow(foveate.Tracker(config=config, channels=channels), [change(p) for p in pictures]) == wanted

    def rgba(p: Any) -> Any:
        return np.concatenate([p, np.full_like(p[..., :1], 9)], axis=2)

    same("bgr", lambda p: p[..., ::-1])  # negative strides, no copy
    same("bgr", lambda p: np.ascontiguousarray(p[..., ::-1]))
    same("rgba", rgba)
    same("bgra", lambda p: rgba(p[..., ::-1]))
    same("rgba", lambda p: p)  # a video's, which has no alpha
    same("bgra", lambda p: p[..., ::-1])
    same("rgb", lambda p: np.asfortranarray(p))
    same("rgb", lambda p: np.ascontiguousarray(p.transpose(2, 0, 1)).transpose(1, 2, 0))  # planes, as PyTorch has them
    same("rgb", lambda p: np.repeat(np.repeat(p, 2, axis=0), 3, axis=1)[::2, ::3])
    same("rgb", lambda p: np.flip(np.ascontiguousarray(np.flip(p))))
    same("rgb", lambda p: rgba(p)[..., :3])
    same("rgb", lambda p: np.frombuffer(p.tobytes(), np.uint8).reshape(p.shape))  # read-only


def test_grey_pictures_need_no_channels(pictures: Any) -> None:
    grey = [np.ascontiguousarray(p[..., 1]) for p in pictures]
    wanted = follow(foveate.Tracker(config={"particles": 60}), grey)
    assert follow(foveate.Tracker(config={"particles": 60}, channels="bgr"), [g[..., None] for g in grey]) == wanted
    assert follow(foveate.Tracker(config={"particles": 60}, channels="grey"), [g[:, :] for g in grey]) == wanted


def test_what_numpy_makes_an_array_of_is_a_picture(pictures: Any) -> None:
    class Wrapped:
        def __init__(self, array: Any) -> None:
            self.__array_interface__ = array.__array_interface__
            self.array = array

    tracker = foveate.Tracker(config={"particles": 60})
    tracker.init(Wrapped(pictures[0]), np.array(FIRST))
    assert tracker.update(Wrapped(pictures[1])).ok


def test_seeds_name_the_track(pictures: Any) -> None:
    config = {"particles": 60}
    one, again, other = (follow(foveate.Tracker(config=config, seed=s), pictures) for s in (1, None, 2))
    assert one == again != other, "the seed of configurations that ship is 1"


def test_threads_do_not_change_a_bit(pictures: Any) -> None:
    wanted = follow(foveate.Tracker(), pictures[:6])
    try:
        for threads in (1, 3):
            foveate.set_threads(threads)
            assert follow(foveate.Tracker(), pictures[:6]) == wanted
        with pytest.raises(foveate.InputError, match="1024; they are 100000"):
            foveate.set_threads(100_000)
    finally:
        foveate.set_threads(0)


def test_configurations(pictures: Any, tmp_path: Path) -> None:
    assert {"natural", "natural-fast", "multi"} <= set(foveate.configurations())
    assert foveate.Tracker("natural").config == foveate.Tracker().config
    tracker = foveate.Tracker("fast", config={"particles": np.int64(70), "policy": {"kind": "hedge", "grid": {"n": 2}}})
    assert "particles = 70" in tracker.config and 'kind = "hedge"' in tracker.config
    own = tmp_path / "own.toml"
    own.write_text(tracker.config)
    boxes = [follow(foveate.Tracker(config=c), pictures[:5]) for c in (own, str(own), tracker.config)]
    assert boxes[0] == boxes[1] == boxes[2] == follow(tracker, pictures[:5])
    for order in (
        {"policy.gamma": 0.5, "policy.kind": "hedge"},  # another kind clears what there was, wherever it stands
        {"policy.gamma": np.float32(0.5), "policy": {"kind": "hedge"}},
        {"policy": {"gamma": 0.5, "kind": "hedge"}},
    ):
        assert foveate.Tracker(config=order).config == foveate.Tracker(config={"policy": {"kind": "hedge", "gamma": 0.5}}).config
    rule = {"nats": 12, "least": 1, "most": 1000}
    for calibrated in ({"likelihood": {"distance": "cosine", "calibrate": rule}}, {"likelihood.calibrate": rule}):
        assert "nats = 12" in foveate.Tracker("natural", config=calibrated).config
    for profile, presence in (("natural", {"extra": 0.5, "cap": 0.25}), ("digits", {"extra": 0.5})):
        assert "extra = 0.5" in foveate.Tracker(profile, config={"likelihood": {"distance": {"presence": presence}}}).config
    for wrong, said in [
        (lambda: foveate.Tracker("natrual"), 'did you mean "natural"'),
        (lambda: foveate.Tracker("Balanced"), 'did you mean "balanced"'),
        (lambda: foveate.MultiTracker("mutli"), 'did you mean "multi"'),
        (lambda: foveate.Tracker("?"), r'no profile "\?"; Profiles are fast, balanced, accurate, .*natural-fast'),
        (lambda: foveate.Tracker(config={"particles": np.array([3, 4])}), "sequence"),
        (lambda: foveate.Tracker(config={"particles": float("nan")}), "nan"),
        (lambda: foveate.Tracker(config={"particels": 3}), "particels"),
        (lambda: foveate.Tracker(config={"particles": 0}), "particles"),
        (lambda: foveate.Tracker(config={"particles": None}), "particles is a NoneType"),
        (lambda: foveate.Tracker(config="particles = 3\n"), "missing field"),
    ]:
        with pytest.raises(foveate.ConfigError, match=said):
            wrong()
    # A dict has no lines.
    for settings in ({"particels": 3}, {"policy": {"kind": "hegde"}}, {"policy.gama": 3}, {"particles": "many"}):
        with pytest.raises(foveate.ConfigError) as found:
            foveate.Tracker(config=settings)
        assert not {"line", "column", "TOML"} & set(re.findall(r"\w+", str(found.value))), found.value
    with pytest.raises(foveate.ConfigError, match="line 2"):
        foveate.Tracker(config=tracker.config.split("\n")[0] + "\nparticels = 3\n")
    with pytest.raises(TypeError, match=r"profile is a name.*it is a dict.*config="):
        foveate.Tracker({"particles": 10})  # type: ignore[arg-type]
    with pytest.raises(foveate.FileError, match="none.toml"):
        foveate.Tracker(config="none.toml")
    with pytest.raises(OSError):
        foveate.Tracker(config=tmp_path / "none.toml")
    with pytest.raises(TypeError, match="it is float"):
        foveate.Tracker(config=3.5)  # type: ignore[arg-type]
    with pytest.raises(foveate.InputError, match='"bgr".*it is "brg"'):
        foveate.Tracker(channels="brg")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("picture", "error", "said"),
    [
        (np.zeros((20, 30, 3)), TypeError, "float64; expected uint8"),
        (np.zeros((20, 30, 3), np.int8), TypeError, "int8"),
        ([[1, 2], [3, 4]], TypeError, "type list"),
        (None, TypeError, "NoneType"),
        (np.zeros((20, 30, 4), np.uint8), foveate.InputError, r"\[20, 30, 4\].*channels=\"rgba\" \(PIL, imageio\).*\"bgra\""),
        (np.zeros((20, 30, 2), np.uint8), foveate.InputError, "shape"),
        (np.zeros((3, 20, 30), np.uint8), foveate.InputError, r"\[3, 20, 30\].*channels come first.*transpose\(1, 2, 0\)"),
        (np.zeros((0, 30), np.uint8), foveate.InputError, "no side 0$"),
        (np.zeros((1, 20, 30, 3), np.uint8), foveate.InputError, r"batch of one picture: give picture\[0\]"),
        (np.zeros(30, np.uint8), foveate.InputError, "shape"),
        (np.zeros((1, 2, 3, 4), np.uint8), foveate.InputError, "shape"),
        (np.zeros((119, 160, 3), np.uint8), foveate.InputError, "160 x 119.*160 x 120"),
        (np.zeros((120, 160), np.uint8), foveate.InputError, "1 planes"),
        (np.broadcast_to(np.uint8(7), (1 << 20, 1 << 20)), foveate.InputError, r"GiB of memory.*foveate.set_max_memory"),
    ],
)
def test_pictures_that_are_none(pictures: Any, picture: Any, error: type[Exception], said: str) -> None:
    tracker = foveate.Tracker(config={"particles": 20})
    tracker.init(pictures[0], FIRST)
    before = tracker.save()
    with pytest.raises(error, match=said):
        tracker.update(picture)
    assert tracker.save() == before, "nothing has changed"
    assert tracker.update(pictures[1]).ok


@pytest.mark.parametrize(
    ("values", "wanted"),
    [
        (np.array([0, 40000, 65535], np.uint16), [0, 156, 255]),
        (np.array([0, 200, 255], np.int64), [0, 200, 255]),
        (np.array([-3, 127, 99], np.int8), [0, 127, 99]),
        (np.array([0.0, 0.5, 1.0]), [0, 128, 255]),
        (np.array([-0.2, 0.4999, 1.3], np.float32), [0, 127, 255]),
        (np.array([False, True, True]), [0, 255, 255]),
    ],
)
def test_the_conversion_that_is_advised_is_right(values: Any, wanted: list[int]) -> None:
    """What the error says, done: no value is cut off or wraps."""
    picture = np.broadcast_to(values, (20, 30, 3))
    with pytest.raises(TypeError, match="expected uint8") as found:
        foveate.Tracker("fast").init(picture, (2, 2, 9, 9))
    advice = re.findall("`(.*?)`", str(found.value))[0]
    bytes_ = eval(advice, {"picture": picture})
    assert bytes_.dtype == np.uint8 and bytes_[0, 0].tolist() == wanted
    foveate.Tracker("fast").init(bytes_, (2, 2, 9, 9))


def test_pictures_of_pillow_have_their_own_order(pictures: Any) -> None:
    pillow = pytest.importorskip("PIL.Image", reason="skipped: no Pillow")
    few = [pillow.fromarray(p).quantize(16) for p in pictures[:6]]
    wanted = follow(foveate.Tracker("fast"), [np.asarray(p.convert("RGB")) for p in few])
    assert few[0].mode == "P" and follow(foveate.Tracker("fast"), few) == wanted, "palettes"
    colour = follow(foveate.Tracker("fast"), pictures[:6])
    for channels in ("rgb", "bgr", "rgba", "grey"):
        for mode in ("RGB", "RGBA"):
            shown = [pillow.fromarray(p).convert(mode) for p in pictures[:6]]
            assert follow(foveate.Tracker("fast", channels=channels), shown) == colour, (channels, mode)  # type: ignore[arg-type]
    grey = [pillow.fromarray(p).convert("L") for p in pictures[:6]]
    assert follow(foveate.Tracker("fast"), grey) == follow(foveate.Tracker("fast"), [np.asarray(p) for p in grey])
    assert follow(foveate.Tracker("fast"), [p.convert("1") for p in grey]) == follow(
        foveate.Tracker("fast"), [255 * np.asarray(p.convert("1")).astype(np.uint8) for p in grey]
    )
    with pytest.raises(TypeError, match="mode is I;16.*8 bits"):
        foveate.Tracker("fast").init(pillow.fromarray(np.zeros((20, 30), np.uint16)), (2, 2, 9, 9))


def test_memory_can_be_allowed(pictures: Any) -> None:
    try:
        foveate.set_max_memory("16M")
        with pytest.raises(foveate.InputError, match=r'more than the 16 MiB allowed.*foveate.set_max_memory\("6G"\)'):
            foveate.Tracker("fast").init(np.zeros((600, 800), np.uint8), (2, 2, 9, 9))
        with pytest.raises(foveate.InputError, match='such as 512M or 6G.*got "much"'):
            foveate.set_max_memory("much")
    finally:
        foveate.set_max_memory(None)
    foveate.Tracker("fast").init(np.zeros((600, 800), np.uint8), (2, 2, 9, 9))


@pytest.mark.parametrize(
    ("box", "error", "said"),
    [
        ((1, 2, 0, 5), foveate.InputError, "at least 2 x 2"),
        ((1, 2, float("nan"), 5), foveate.InputError, "finite"),
        ((500, 2, 10, 5), foveate.InputError, "touching the 160 x 120 picture"),
        ((-300, -200, 700, 500), foveate.InputError, "at most 640 x 480, touching"),
        ((1, 2, 3), TypeError, r"\(1, 2, 3\)"),
        ("left", TypeError, "four numbers"),
        (7, TypeError, "four numbers"),
        (None, TypeError, "four numbers"),
        ((1, 2, 3, "x"), TypeError, "four numbers"),
        (np.zeros((120, 160, 3), np.uint8), TypeError, "of type ndarray$"),
        (itertools.count(), TypeError, "four numbers"),
    ],
)
def test_boxes_that_are_none(pictures: Any, box: Any, error: type[Exception], said: str) -> None:
    tracker = foveate.Tracker(config={"particles": 20})
    with pytest.raises(error, match=said) as found:
        tracker.init(pictures[0], box)
    assert "--init" not in str(found.value), "it is the program that has options"
    assert not tracker.has_target


def test_a_tracker_without_a_target_says_so(pictures: Any) -> None:
    tracker = foveate.Tracker(config={"particles": 20})
    assert "no target yet" in repr(tracker)
    for act in (lambda: tracker.update(pictures[0]), lambda: tracker.reset_at(FIRST)):
        with pytest.raises(foveate.InputError, match="init"):
            act()
    tracker.init(pictures[0], FIRST)
    assert "no target" not in repr(tracker)


def test_a_pickle_goes_on_bit_for_bit(pictures: Any) -> None:
    tracker = foveate.Tracker(config={"particles": 60}, seed=3)
    follow(tracker, pictures[:8])
    copies = [pickle.loads(pickle.dumps(tracker)), copy.copy(tracker), copy.deepcopy(tracker)]
    boxes = [[t.update(p).box for p in pictures[8:16]] for t in [tracker, *copies]]
    assert boxes[0] == boxes[1] == boxes[2] == boxes[3]
    fresh = pickle.loads(pickle.dumps(foveate.Tracker("fast", channels="bgr")))
    assert not fresh.has_target and fresh.channels == "bgr"


@pytest.mark.parametrize("kind", [foveate.Tracker, foveate.MultiTracker])
def test_a_refused_picture_is_forgotten(pictures: Any, kind: Any) -> None:
    tracker = kind(config={"particles": 60})
    if kind is foveate.Tracker:
        tracker.init(pictures[0], FIRST)
    tracker.update(pictures[1])
    before = pickle.dumps(tracker)
    with pytest.raises(foveate.InputError, match="160 x 50"):
        tracker.update(pictures[2][:50])
    assert pickle.dumps(tracker) == before


def test_a_saved_state_goes_on_bit_for_bit(pictures: Any) -> None:
    tracker, other = (foveate.Tracker(config={"particles": 60}) for _ in range(2))
    follow(tracker, pictures[:8])
    other.load(tracker.save())
    other.skip(pictures[7])
    assert [tracker.update(p).box for p in pictures[8:]] == [other.update(p).box for p in pictures[8:]]
    for wrong in (b"", b"{}", b"[1]", b"\xff", tracker.save()[:-5], tracker.save().replace(b'"format":', b'"format":1')):
        with pytest.raises(foveate.InputError, match="saved"):
            other.load(wrong)
    with pytest.raises(foveate.InputError, match="saved|particles"):
        foveate.Tracker(config={"particles": 61}).load(tracker.save())


def test_reset_and_visibility(pictures: Any) -> None:
    tracker = foveate.Tracker(config={"particles": 60})
    follow(tracker, pictures[:4])
    tracker.reset_at((40 + 3 * 10, 30 + 10, 24, 24))
    assert abs(tracker.update(pictures[11]).box.x - 73) < 4
    tracker.set_visibility(0.2)
    for wrong in (-1, 2, float("nan")):
        with pytest.raises(foveate.InputError, match="0 to 1"):
            tracker.set_visibility(wrong)


def test_predictions_move_on_and_grow(pictures: Any) -> None:
    tracker = foveate.Tracker(config={"particles": 60})
    with pytest.raises(foveate.InputError, match="predict"):
        tracker.predict(1)
    follow(tracker, pictures[:8])
    seen = tracker.update(pictures[8])
    now, ahead = tracker.predict(0), tracker.predict(2.5)
    assert now.box == seen.box and now.p_lost == seen.p_lost and len(now.particles) == 0
    assert ahead.box.x > now.box.x and ahead.covariance[0, 0] > now.covariance[0, 0]
    for wrong in (-1, float("nan")):
        with pytest.raises(foveate.InputError, match="frames"):
            tracker.predict(wrong)
    with pytest.raises(foveate.InputError, match="set_time"):
        tracker.predict_at(1.0)
    other = copy.deepcopy(tracker)
    with pytest.raises(foveate.InputError, match="no result yet"):
        other.predict(1)
    other.update(pictures[9])
    assert other.predict(1).box.x > now.box.x


def test_dropped_frames_move_the_particles(pictures: Any) -> None:
    def expected(timed: bool) -> float:
        tracker = foveate.Tracker(config={"particles": 600, "dynamics.damping": 1, "camera_motion": "none"})
        for t in [*range(12), 17]:
            if timed:
                tracker.set_time(3 + t / 25)
            seen = tracker.init(pictures[0], FIRST) if t == 0 else tracker.update(pictures[t])
        if timed:
            at, by = tracker.predict_at(3 + 19 / 25), tracker.predict(2)
            assert abs(at.box.x - by.box.x) < 1e-6
        return float(seen.particles[:, 0].mean())

    assert 8 < expected(True) - expected(False) < 16, "five more frames of 3 px"


def test_detections_of_others(pictures: Any) -> None:
    tracker = foveate.Tracker("multi", config={"particles": 60})
    tracker.init(pictures[0], FIRST)
    assert tracker.update_with(pictures[1], [[43, 31, 24, 24, 0.9]]).ok
    assert tracker.update_with(pictures[2], []).box
    for wrong, error in [([[1, 2, 3]], foveate.InputError), ([[1, 2, 3, float("nan")]], foveate.InputError), ("x", TypeError)]:
        with pytest.raises(error):
            tracker.update_with(pictures[3], wrong)


def test_detections_that_nothing_uses_are_refused(pictures: Any) -> None:
    detections = [[43, 31, 24, 24, 0.9]]
    tracker = foveate.Tracker("fast", config={"particles": 60})
    tracker.init(pictures[0], FIRST)
    with pytest.raises(foveate.InputError, match="uses no detections.*detection_likelihood.place=0.2"):
        tracker.update_with(pictures[1], detections)
    for config in ({"detection_likelihood.place": 0.2}, {"proposal.kind": "mixture", "dynamics.tail_probability": 0}):
        tracker = foveate.Tracker("fast", config=config)
        tracker.init(pictures[0], FIRST)
        assert tracker.update_with(pictures[1], detections).ok


def test_a_state_of_other_settings_is_refused(pictures: Any) -> None:
    def made(**options: Any) -> foveate.Tracker:
        return foveate.Tracker(**{"config": {"particles": 60}, "seed": 3, **options})

    tracker = made()
    follow(tracker, pictures[:3])
    saved = tracker.save()
    made().load(saved)
    made(channels="rgba").load(saved)  # the same colours in the same order
    for options, words in [
        ({"seed": 4}, "seed is 3 in the state and 4 in this tracker"),
        ({"channels": "bgr"}, 'saved with channels="rgb", this tracker has channels="bgr"'),
        ({"config": {"particles": 60, "box_regression": "none"}}, "box_regression is set in the state and not set in this tracker"),
        ({"config": {"particles": 60, "variation": "none"}}, "variation is set in the state and not set in this tracker"),
        ({"config": {"particles": 61}}, "particles is 60 in the state and 61 in this tracker"),
    ]:
        with pytest.raises(foveate.InputError, match=words):
            made(**options).load(saved)
    many = foveate.MultiTracker(seed=3)
    foveate.MultiTracker(seed=3).load(many.save())
    with pytest.raises(foveate.InputError, match="seed is 3 in the state and 4 in this tracker"):
        foveate.MultiTracker(seed=4).load(many.save())


def test_a_second_start_is_a_fresh_one(pictures: Any) -> None:
    fresh, again = foveate.Tracker("fast"), foveate.Tracker("fast")
    again.init(pictures[5], (40 + 3 * 5, 30 + 5, 24, 24))
    for picture in pictures[6:9]:
        again.update(picture)
    for tracker in (fresh, again):
        tracker.init(pictures[0], FIRST)
    for picture in pictures[1:5]:
        one, other = fresh.update(picture), again.update(picture)
        assert (tuple(one.box), one.p_lost) == (tuple(other.box), other.p_lost)


def test_the_interpreter_is_free_while_a_tracker_works(pictures: Any) -> None:
    """Threads with a tracker each end with the boxes of one after the other; and one tracker may be shared."""
    wanted = [follow(foveate.Tracker(config={"particles": 60}, seed=s), pictures) for s in range(4)]
    found: dict[int, Any] = {}

    def work(seed: int) -> None:
        found[seed] = follow(foveate.Tracker(config={"particles": 60}, seed=seed), pictures)

    threads = [threading.Thread(target=work, args=(seed,)) for seed in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [found[s] for s in range(4)] == wanted
    shared = foveate.Tracker(config={"particles": 60})
    shared.init(pictures[0], FIRST)
    threads = [threading.Thread(target=lambda: [shared.update(pictures[1]) for _ in range(20)]) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert shared.update(pictures[1]).ok


def _forked(picture: Any, queue: Any) -> None:
    tracker = foveate.Tracker(config={"particles": 200})
    tracker.init(picture, FIRST)
    queue.put(tuple(tracker.update(picture).box))


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="skipped: no fork")
def test_a_forked_process_has_threads_of_its_own(pictures: Any) -> None:
    tracker = foveate.Tracker(config={"particles": 200})
    tracker.init(pictures[0], FIRST)
    wanted = tuple(tracker.update(pictures[0]).box)
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    child = context.Process(target=_forked, args=(pictures[0], queue))
    child.start()
    assert queue.get(timeout=60) == wanted
    child.join(60)
    assert child.exitcode == 0

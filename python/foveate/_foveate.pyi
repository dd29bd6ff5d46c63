from collections.abc import Iterable, Iterator, Mapping, Sequence
from os import PathLike
from typing import Any, Literal, Protocol, TypeAlias, final

import numpy as np
import numpy.typing as npt

from ._multi import Targets
from ._result import Result, Status
from ._types import Box, Region, State

__VERSION__: str

_Floats: TypeAlias = npt.NDArray[np.float64]
_Singles: TypeAlias = npt.NDArray[np.float32]
_Channels: TypeAlias = Literal["rgb", "bgr", "rgba", "bgra", "grey"]
_Config: TypeAlias = Mapping[str, Any] | str | PathLike[str]
_Box: TypeAlias = Sequence[float] | npt.NDArray[np.floating[Any] | np.integer[Any]]

class _Array(Protocol):
    """A picture that NumPy makes an array of, such as PIL's."""

    @property
    def __array_interface__(self) -> dict[str, Any]: ...

class _Found(Protocol):
    """Detections as supervision has them; ultralytics calls its scores ``conf``."""

    @property
    def xyxy(self) -> npt.NDArray[Any]: ...

class _Results(Protocol):
    """What an ultralytics model answers for a picture."""

    @property
    def boxes(self) -> Any: ...
    @property
    def obb(self) -> Any: ...

_Image: TypeAlias = npt.NDArray[np.uint8] | npt.NDArray[np.integer[Any] | np.floating[Any]] | _Array
_Detections: TypeAlias = npt.ArrayLike | _Found | _Results | Sequence[_Results]

@final
class _Estimate:
    @property
    def ok(self) -> bool: ...
    @property
    def box(self) -> Box: ...
    @property
    def p_lost(self) -> float: ...
    @property
    def status(self) -> Status: ...
    @property
    def state(self) -> State: ...
    @property
    def covariance(self) -> _Floats: ...
    @property
    def ess(self) -> float: ...
    @property
    def log_evidence(self) -> float: ...
    @property
    def particles(self) -> _Floats: ...
    @property
    def weights(self) -> _Floats: ...
    @property
    def gaze(self) -> tuple[float, float]: ...
    @property
    def gazes(self) -> _Floats: ...
    @property
    def rewards(self) -> _Floats: ...
    @property
    def classes(self) -> dict[str, float]: ...
    def region(self, p: float = 0.9) -> Region: ...
    def __reduce__(self) -> tuple[Any, ...]: ...

@final
class Tracker:
    """Follows one target through video.

    Parameters
    ----------
    profile : str
        ``"balanced"``, ``"fast"`` (nearly three times the speed), ``"accurate"`` (three trackers that vote: fewest failures, a third of the
        speed), or the name of any shipped configuration: :func:`foveate.configurations` lists them.
    config : dict, path or str, optional
        A dict changes settings of the profile: ``{"particles": 400, "policy.kind": "hedge"}``. A path (``str`` or
        ``os.PathLike``) is a TOML file that replaces the profile; a ``str`` of more than one line is the TOML itself.
    seed : int, optional
        Seed of all random numbers: the same seed gives the same track, bit for bit. Default: the configuration's seed, which is 1 in
        the shipped ones.
    channels : str
        The order of a colour picture's bytes: ``"rgb"`` (PIL, imageio), ``"bgr"`` (OpenCV), ``"rgba"`` or ``"bgra"``. Pictures of
        shape (height, width) are always grey.

    Raises
    ------
    foveate.ConfigError
        There is no such profile, a setting is misspelled or out of range.
    foveate.FileError
        A configuration or a model file cannot be read.

    Examples
    --------
    >>> import numpy as np, foveate
    >>> def picture(t):
    ...     image = np.arange(160 * 120, dtype=np.uint8).reshape(120, 160) % 7
    ...     image[40:64, 50 + 4 * t : 74 + 4 * t] = 200
    ...     return image
    >>> tracker = foveate.Tracker("fast")
    >>> seen = tracker.init(picture(0), (46, 36, 32, 32))
    >>> for t in range(1, 8):
    ...     ok, box = tracker.update(picture(t))
    >>> ok, abs(box.x - 74) < 4
    (True, True)
    """
    def __new__(
        cls,
        profile: str = "balanced",
        config: _Config | None = None,
        seed: int | None = None,
        *,
        channels: _Channels = "rgb",
    ) -> Tracker: ...
    def init(self, image: _Image, box: _Box) -> Result:
        """Starts or restarts on the target in this box. A restart resets all learned models and the random streams, so that the tracker
        continues as a new one would, bit for bit. It keeps only the earlier pictures used by the detector and the camera motion.

        Parameters
        ----------
        image : uint8 array, (height, width) or (height, width, channels)
            Any strides; read in place. Colour and grey pictures cannot be mixed.
        box : four numbers
            Left, top, width, height; pixels from 0. At least 2 x 2 pixels, touching the picture.

        Returns
        -------
        Result
            The result of the picture with the given box: the box itself, P(lost) 0, no particles.

        Raises
        ------
        TypeError
            The picture is not an array of uint8, or the box is not four numbers.
        foveate.InputError
            The shape of the picture does not match its channels, or the box is empty, not finite or outside; nothing has changed.
        """
    def update(self, image: _Image) -> Result:
        """Tracks the target in the next picture of the video.

        Parameters
        ----------
        image : uint8 array
            As in :meth:`init`, of the same size.

        Returns
        -------
        Result
            Unpacks to ``ok, box``.

        Raises
        ------
        foveate.InputError
            There is no target yet, or the picture has another size than the first.
        """
    def update_with(self, image: _Image, detections: _Detections) -> Result:
        """Tracks the target in the next picture with the detections of your detector, which replace those of the configuration's detector.

        Parameters
        ----------
        image : uint8 array
            As in :meth:`update`.
        detections : array (n, 4) or (n, 5), or anything with ``xyxy`` and ``confidence``
            Left, top, width, height and, in a fifth column, score; or for example ``supervision.Detections``.

        Raises
        ------
        foveate.InputError
            As :meth:`update`; or the configuration uses no detections. ``config={"detection_likelihood.place": 0.2}`` makes them weight
            particles; ``config={"proposal.kind": "mixture", "dynamics.tail_probability": 0}`` makes them move particles.
        """
    def track(
        self, video: Video | str | PathLike[str] | int | Iterable[Any], box: _Box | None = None, *, progress: bool | None = None
    ) -> Iterator[Result]:
        """Follows the target through a video, picture by picture: an iterator of results, which holds one picture at a time.

        Parameters
        ----------
        video : Video, path, camera index, or iterable of pictures
            A path, an address or a camera's number is opened as :class:`Video` and closed at the end.
        box : four numbers, optional
            The target in the first picture, as in :meth:`init`. Omit it to continue with the current target.
        progress : bool, optional
            Whether to show progress on standard error. Default: only if it is a terminal.

        Yields
        ------
        Result
            One for each picture, including the first. ``image`` is the picture until the next one is read; ``frame`` and ``time``
            give its place in the video.

        Raises
        ------
        foveate.InputError
            There is no target and no box.

        Examples
        --------
        >>> import foveate
        >>> tracker = foveate.Tracker("fast")
        >>> for seen in tracker.track("walk.mp4", (40, 30, 24, 24)):  # doctest: +SKIP
        ...     print(seen.frame, seen.time, seen.box.rounded(), seen.p_lost)
        """
    def skip(self, image: _Image) -> None:
        """Observes a picture without tracking: before the target is given, or before the first update after :meth:`load`. Camera motion and
        detector compare pictures.
        """
    def reset_at(self, box: _Box) -> None:
        """Moves the target to this box: particles start around it, and P(lost) is 0 until the next picture. Everything else stays: the
        template, the learned models, and the random streams, which continue.
        """
    def predict(self, dt: float) -> Result:
        """Predicts the box and its covariance ``dt`` frames after the last picture, from the dynamics. The tracker does not change; status and
        P(lost) are those of the last picture.

        Parameters
        ----------
        dt : float
            Frames, 0 or more; multiply seconds by the frame rate. Between whole frames mean and covariance are interpolated.

        Returns
        -------
        Result
            Without particles. The box may lie outside the picture.

        Raises
        ------
        foveate.InputError
            There is no result yet, also after :meth:`load`, and in a copy or from a pickle, until the next update; or ``dt`` is out
            of range.
        """
    def predict_at(self, seconds: float) -> Result:
        """Predicts as :meth:`predict` does, for a time in seconds on the clock of :meth:`set_time`: that of the motor's action.

        Raises
        ------
        foveate.InputError
            As :meth:`predict`; or fewer than two pictures have a time, or it lies before the last picture.
        """
    def set_time(self, seconds: float) -> None:
        """Sets the time of the next picture, seconds from any origin. If frames were dropped before it, the particles move for as many frames
        more, 30 at most; at a constant rate nothing changes. :meth:`track` calls it for videos.
        """
    def set_visibility(self, visible: float) -> None:
        """Sets the fraction of the target that the next pictures can show, 0 to 1, if something covers it; 1 by default."""
    def save(self) -> bytes:
        """Returns the whole state during a video, as JSON in UTF-8, for :meth:`load` in a tracker of the same configuration and seed.

        It lacks the last picture, which detector and camera motion need: call :meth:`skip` with it before the next update. A pickle
        contains that picture. Neither contains the background model of a detector (``kind = "motion"``, ``"walkers"``), which is learned
        again.
        """
    def load(self, saved: bytes) -> None:
        """Restores a state from :meth:`save` in a tracker of the same configuration, seed and channels. After an error the tracker needs a
        new :meth:`init`.

        Raises
        ------
        foveate.InputError
            The state is invalid, of another version, or of another configuration, seed or order of channels: the message names
            the difference. The contents of model files are not compared.
        """
    @property
    def has_target(self) -> bool:
        """Whether there is a target: it was given, or loaded."""
    @property
    def config(self) -> str:
        """The configuration as TOML, with every setting."""
    @property
    def seed(self) -> int:
        """The seed of all random numbers."""
    @property
    def channels(self) -> _Channels:
        """The order of a colour picture's bytes."""
    def __reduce__(self) -> tuple[Any, ...]: ...

@final
class MultiTracker:
    """Follows many targets, started by given boxes or by detections.

    The parameters are those of :class:`Tracker`; the default profile is ``"multi"`` (people and cars, with your own
    detector).

    Examples
    --------
    >>> import numpy as np, foveate
    >>> tracker = foveate.MultiTracker()
    >>> image = np.zeros((120, 160, 3), np.uint8)
    >>> image[40:60, 30:50] = 200
    >>> for _ in range(5):
    ...     targets = tracker.update(image, [[30, 40, 20, 20, 0.9]])    # left, top, width, height, score
    >>> targets.ids.tolist(), targets.boxes.shape
    ([1], (1, 4))
    """
    def __new__(
        cls,
        profile: str = "multi",
        config: _Config | None = None,
        seed: int | None = None,
        *,
        channels: _Channels = "rgb",
    ) -> MultiTracker: ...
    def update(self, image: _Image, detections: _Detections | None = None, *, lost: bool = False) -> Targets:
        """Tracks all targets in the next picture, given the detections of your detector.

        Parameters
        ----------
        image : uint8 array, (height, width) or (height, width, channels)
        detections : array (n, 4) or (n, 5), or anything with ``xyxy`` and ``confidence``, optional
            Left, top, width, height and score; or for example ``supervision.Detections`` with classes and data, which are copied to the
            targets. Default: none. Give scores if available: without them no track starts beside another target.
        lost : bool
            Whether to return targets in the phase "lost" too; their boxes are guesses.

        Returns
        -------
        Targets
            The targets, by id; ``detection_index`` has the index of the detection of each target.

        Raises
        ------
        InputError
            A detection is not finite, or has no width or height; the message names it.
        """
    def add(self, image: _Image, box: _Box, id: int | None = None) -> int:
        """Sets a target's box in the picture of the last update: starts a new target, or restarts an active one. Returns its id, by default
        the next free one.
        """
    def remove(self, id: int) -> None:
        """Ends the track of the target with this id permanently: it is not re-identified later. Raises KeyError if no active target has it."""
    def skip(self, image: _Image) -> None:
        """Observes a picture without tracking in it: camera motion and detector compare pictures."""
    def cut(self) -> None:
        """Marks a cut before the next picture: all targets are terminated, and re-identified if they return."""
    @property
    def targets(self) -> Targets:
        """All active targets of the last picture, by id, including those in the phase "lost", whose boxes are guesses."""
    def save(self) -> bytes:
        """Returns the whole state, as JSON in UTF-8; see :meth:`Tracker.save`. It lacks the names of classes; a pickle contains them."""
    def load(self, saved: bytes) -> None:
        """Restores a state from :meth:`save`, in a tracker of the same configuration, seed and channels, and clears the names of classes; after
        an error nothing has changed.
        """
    @property
    def config(self) -> str:
        """The configuration as TOML, with every setting."""
    @property
    def seed(self) -> int:
        """The seed of all random numbers."""
    @property
    def channels(self) -> _Channels:
        """The order of a colour picture's bytes."""
    def __reduce__(self) -> tuple[Any, ...]: ...
    def __setstate__(self, names: dict[int, str]) -> None: ...

@final
class Video:
    """The pictures of a video file, a folder of images, a stream or a camera, one after the other.

    Each loop continues at the end of the previous one; after the last picture the next loop starts again. It can be used in a ``with``
    statement, which closes it.

    Parameters
    ----------
    source : path, address or camera index
        H.264 in MP4, a folder of JPEG or PNG images, a numbered pattern of images (``"frames/%04d.png"``), one image; with ffmpeg
        installed also other videos, streams (``"rtsp://..."``, ``"http://..."``), and cameras, by their number or
        ``"/dev/video0"``. Streams and cameras yield their newest picture.
    channels : str
        ``"rgb"`` or ``"bgr"``: the channel order of colour pictures; grey pictures have shape (height, width).
    start : int
        The first picture, counted from 0.
    every : int
        Read only every n-th picture from there on.

    Raises
    ------
    foveate.FileError
        The source does not exist or cannot be read; while iterating, the source breaks off.
    foveate.InputError
        There is no picture ``start``; if the number of pictures is unknown, the first read raises it.

    Examples
    --------
    >>> import foveate
    >>> with foveate.Video("walk.mp4", every=2) as video:  # doctest: +SKIP
    ...     for image in video:
    ...         print(video.frame, video.time, image.shape)
    """
    def __new__(
        cls,
        source: str | PathLike[str] | int,
        *,
        channels: Literal["rgb", "bgr"] = "rgb",
        start: int = 0,
        every: int = 1,
    ) -> Video: ...
    def __iter__(self) -> Video: ...
    def __next__(self) -> npt.NDArray[np.uint8]: ...
    def __len__(self) -> int: ...
    def __length_hint__(self) -> int: ...
    def __bool__(self) -> bool: ...
    def __enter__(self) -> Video: ...
    def __exit__(self, *_exception: object) -> None: ...
    def close(self) -> None:
        """Stops reading, and ends the decoding program if there is one. A closed video cannot be read."""
    def seek(self, frame: int) -> None:
        """Moves to a picture, counted from 0, which is read next. Immediate in folders; videos are decoded from the current place, or from
        the beginning if the current place is later.

        Raises
        ------
        foveate.InputError
            There is no such picture, or it is an earlier one of a stream, which cannot be read again. If the number of pictures is
            unknown, the next read raises it.
        """
    @property
    def size(self) -> tuple[int, int]:
        """Width and height of a picture, pixels."""
    @property
    def frames(self) -> int | None:
        """Number of pictures in the source, if known; an estimate for sources read with ffmpeg."""
    @property
    def rate(self) -> float:
        """Pictures per second."""
    @property
    def frame(self) -> int | None:
        """The index of the last picture read in the source, counted from 0; ``None`` before the first one."""
    @property
    def time(self) -> float | None:
        """The time of the last picture read, seconds from the first picture of the source; ``None`` before the first one. Pictures of a folder
        are 1/30 s apart; streams and cameras use the clock.
        """
    @property
    def dropped(self) -> int:
        """Number of pictures of a stream or camera that were dropped because the previous one was still being processed; 0 for files."""

@final
class Policy:
    """A policy; the Python interface is in `foveate.bandits`."""
    def __new__(cls, kind: str, arms: int, rate: str, seed: int) -> Policy: ...
    def ask(self) -> int:
        """Returns the next arm."""
    def tell(self, rewards: Sequence[float]) -> None:
        """Sets the rewards of the arms of the last plan, in their order."""
    def probabilities(self) -> _Floats | None:
        """Returns the probability of each arm for the next choice."""
    def save(self) -> tuple[str, int]:
        """Returns the whole state as JSON, and the number of calls of `ask`."""
    def load(self, saved: str, asked: int) -> None:
        """Restores a state from `save`; drops an arm without a reward."""

@final
class Optimiser:
    """Bayesian optimisation; the Python interface is `foveate.bandits.GpUcb`."""
    def __new__(cls, bounds: Sequence[tuple[float, float]], settings: str, seed: int) -> Optimiser: ...
    def ask(self) -> list[float]:
        """Returns the next point."""
    def tell(self, point: Sequence[float], value: float) -> None:
        """Sets the value of a point."""
    def best(self) -> list[float] | None:
        """Returns the observed point with the largest mean."""
    def predict(self, points: _Floats) -> tuple[_Floats, _Floats]:
        """Returns mean and standard deviation at each point."""
    def save(self) -> str:
        """Returns the whole state as JSON."""
    def load(self, saved: str) -> None:
        """Restores a state from `save`."""

def draw_marks(
    image: _Image,
    channels: str,
    boxes: _Floats,
    colours: Sequence[tuple[int, int, int]],
    texts: Sequence[str],
    discs: _Floats,
    paths: Sequence[tuple[_Floats, tuple[int, int, int]]],
) -> npt.NDArray[np.uint8]:
    """The picture with these marks: boxes (left, top, width, height) with a colour and a text each, discs (x, y and a share of 1 that
    colours them), and paths with a colour each. A colour picture in the order of the channels; of a grey one, and of one with alpha, without.
    """
def export_boxes(
    format: str,
    path: str | PathLike[str],
    rows: Sequence[tuple[int, int, tuple[float, float, float, float], float]],
    frames: int,
    size: tuple[int, int] | None,
) -> list[str]:
    """Writes the boxes of a video with this number of pictures. Returns one sentence for each kind of information that the format does not
    hold.
    """
def measure_tracks(
    points: Sequence[tuple[str, Sequence[tuple[Any, ...]]]],
    reference: Sequence[tuple[Any, ...]] | None,
    ruler: tuple[Sequence[float], float, float] | None,
    origin: tuple[float, float] | None,
    angle: float,
    clock: tuple[float, float] | None,
    fits: Sequence[str],
    lens: tuple[str | PathLike[str], tuple[int, int]] | None,
) -> list[dict[str, Any]]:
    """Measures the motion of points: one dictionary of the fields of `foveate.Measurement` for each. With the lens comes the size of the pictures."""
def select(weights: _Floats, count: int, scheme: str, seed: int, step: int) -> npt.NDArray[np.int64]:
    """For each of `count` places of the next step, the index of the particle that takes it; ascending."""
def learn_fit(kind: str, recipe: str, x: _Singles) -> dict[str, _Singles]:
    """Trains on the rows of `x`; for filters also returns their cost. Ctrl-C ends it."""
def learn_codes(kind: str, recipe: str, tensors: Mapping[str, _Singles], x: _Singles) -> _Singles:
    """Returns the model's codes of each row of `x`."""
def learn_scores(kind: str, recipe: str, tensors: Mapping[str, _Singles], x: _Singles) -> _Floats:
    """Returns log p(v) of each row of `x`, nats, up to a constant."""
def softmax_fit(
    x: _Floats,
    labels: npt.NDArray[np.uint8],
    weights: _Floats | None,
    classes: int,
    l2: float,
    steps: int,
    tolerance: float,
) -> tuple[_Floats, _Floats, int, bool]:
    """Fits softmax regression to rows, their labels (0 to `classes` − 1) and weights: weights (n_in × classes), bias, the steps that it
    took, and whether it converged. Ctrl-C ends it.
    """
def score_ope(found: _Floats, truth: _Floats) -> str:
    """Returns the scores and curves of one track, as JSON."""
def score_mot(found: _Floats, truth: _Floats) -> str:
    """Returns the scores of many targets, as JSON. Rows: frame, id, left, top, width, height, confidence."""
def _restore_result(*pickle: Any) -> _Estimate: ...
def _restore_tracker(*pickle: Any) -> Tracker: ...
def _restore_multi(*pickle: Any) -> MultiTracker: ...
def run_program(arguments: Sequence[str], program: str) -> int:
    """Runs the program with these arguments, its name first; `program` is the file that has its code."""
def set_threads(threads: int) -> None:
    """Sets the number of threads of every update from now on, 0 for all processors; results do not depend on it."""
def set_max_memory(size: str | None) -> None:
    """Sets the memory limit for pictures, targets and settings, such as ``"6G"`` or ``"512M"``; exceeding it is an error.
    ``None`` is the default, a quarter of the machine's memory. Results do not depend on it.

    Raises
    ------
    foveate.InputError
        The size is invalid or less than 16M.
    """
def configurations() -> list[str]:
    """Returns the names of the shipped configurations: each is a profile."""
def document(title: str, verdict: str, about: str, body: str) -> str:
    """Returns a page in the style of the reports. `title` is text; the first sentence, one more line, and the body are HTML."""

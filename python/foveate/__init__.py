"""Follow one target or many through video, on a CPU.

>>> import foveate
>>> tracker = foveate.Tracker("balanced", channels="bgr")    # OpenCV's order
>>> tracker
<foveate.Tracker seed=1 channels=bgr, no target yet>

You give a box in the first picture (``tracker.init(image, box)``); every later picture (``tracker.update(image)``) returns a
:class:`Result` with the box, its covariance, a status, and the probability that the target is lost. :class:`MultiTracker` follows
many.
"""

from ._draw import draw
from ._export import export
from ._foveate import MultiTracker, Tracker, Video, configurations, set_max_memory, set_threads
from ._foveate import __VERSION__ as __version__
from ._measure import Measurement, measure
from ._multi import Targets
from ._result import Result
from ._show import Run
from ._types import Box, Region, State
from .errors import ConfigError, Error, FileError, InputError

__all__ = [
    "Box",
    "ConfigError",
    "Error",
    "FileError",
    "InputError",
    "Measurement",
    "MultiTracker",
    "Region",
    "Result",
    "Run",
    "State",
    "Targets",
    "Tracker",
    "Video",
    "__version__",
    "configurations",
    "draw",
    "export",
    "measure",
    "set_max_memory",
    "set_threads",
]

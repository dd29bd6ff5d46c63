"""The program: ``foveate``, or ``python -m foveate``."""

from __future__ import annotations

import signal
import sys

from . import _foveate


def main() -> int:
    """Runs the program with this process' arguments; answers its exit status."""
    # Python's own handler would only note Ctrl-C, and the program is not Python. Its commands set theirs.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    name = "foveate" if sys.argv[0].endswith("__main__.py") else sys.argv[0]
    return _foveate.run_program([name, *sys.argv[1:]], _foveate.__file__)


if __name__ == "__main__":
    sys.exit(main())

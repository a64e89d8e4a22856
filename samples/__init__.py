"""One package per course section; `python -m samples.SECTION` runs its main job.

Installed, `python -m warp_neural.samples.SECTION`.
"""

import os
import signal
import sys


def _stop(*_) -> None:
    """Until `cli.run`, Ctrl-C ends a command without a traceback."""
    os.write(2, b"stopped\n")
    os._exit(130)


if sys.argv[:1] == ["-m"]:
    signal.signal(signal.SIGINT, _stop)

from warp_neural.kernels import Alias

if __name__ == "samples":  # of a checkout
    sys.meta_path.insert(0, Alias(__name__))

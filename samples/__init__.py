"""One package per course section; `python -m samples.SECTION` runs its main job.

Installed, `python -m warp_neural.samples.SECTION`.
"""

import signal
import sys

if sys.argv[:1] == ["-m"]:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # until `cli.run`, Ctrl-C ends a command without a traceback

from warp_neural.kernels import Alias

if __name__ == "samples":  # of a checkout
    sys.meta_path.insert(0, Alias(__name__))

"""The measurements. `python -m perf` runs all that the machine can, `python -m perf.NAME` one; `perf.report` gathers
them in RESULTS.md, `perf.compare` sets two folders of results side by side. `perf.measure` is what they share.
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

"""The measurements. `python -m perf` runs all that the machine can, `python -m perf.NAME` one; `perf.report` gathers
them in RESULTS.md, `perf.compare` sets two folders of results side by side. `perf.measure` is what they share.
"""

import signal
import sys

if sys.argv[:1] == ["-m"]:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # until `cli.run`, Ctrl-C ends a command without a traceback

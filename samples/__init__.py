"""One package per course section; `python -m samples.SECTION` runs its main job.

Installed, `python -m warp_neural.samples.SECTION`.
"""

import sys

from warp_neural.kernels import Alias

if __name__ == "samples":  # of a checkout
    sys.meta_path.insert(0, Alias(__name__))

"""What is close enough on a page."""

import numpy as np

CLOSE, SHARE = 2 / 255, 0.999  # of pixels so close


def check(codes, expected):
    off = np.abs(codes / 255 - expected).max(-1)
    assert (off <= CLOSE).mean() >= SHARE, f"{(off <= CLOSE).mean()} of the pixels, off by {off.max()} at most"
    assert codes.std() > 5

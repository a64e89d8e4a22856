"""Which page lies in which slot of a cache: those that were used least recently leave."""

from dataclasses import dataclass

import numpy as np

_NEVER_LEAVES = np.iinfo(np.int64).max


@dataclass(frozen=True)
class Changes:
    """pages, slots: what comes in, and where. left: the page that leaves each slot, -1 if it was free. misses: pages
    that were wanted and not there, those that find no slot now too."""

    pages: np.ndarray
    slots: np.ndarray
    left: np.ndarray
    misses: int


class TileCache:
    """pages: that there are; slots: at least one more than there are `kept` pages, which never leave.

    slot_of [pages], page_of [slots]: -1 if none. used [slots]: when, in an order of all uses.
    """

    def __init__(self, pages: int, slots: int, kept: int):
        self.slot_of = np.full(pages, -1)
        self.page_of = np.full(slots, -1)
        self.used = np.zeros(slots, np.int64)
        self.slot_of[:kept] = self.page_of[:kept] = np.arange(kept)
        self.used[:kept] = _NEVER_LEAVES
        self.time = 1

    def want(self, pages: np.ndarray, most: int | None = None) -> Changes:
        """Uses `pages`, each once, the first ones first, and brings in those that are missing, `most` at most, in place
        of what was not used now."""
        began = self.time
        slots = self.slot_of[pages]
        self._use(slots[slots >= 0])
        missing = pages[slots < 0]
        free = np.flatnonzero(self.used < began)
        free = free[np.argsort(self.used[free], kind="stable")]
        count = min(len(missing), len(free), len(missing) if most is None else most)
        new, slots = missing[:count], free[:count]
        left = self.page_of[slots]
        self.slot_of[left[left >= 0]] = -1
        self.slot_of[new], self.page_of[slots] = slots, new
        self._use(slots)
        return Changes(new, slots, left, len(missing))

    def _use(self, slots: np.ndarray) -> None:
        times = self.time + np.arange(len(slots))
        self.used[slots] = np.maximum(self.used[slots], times)
        self.time += len(slots)

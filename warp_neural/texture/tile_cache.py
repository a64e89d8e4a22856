"""Which page lies in which slot of a cache: those that were used least recently leave."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Changes:
    """pages, slots: what comes in, and where. left: the page that leaves each slot, -1 if it was free. misses: pages
    that were wanted and not there, those that do not come in included."""

    pages: np.ndarray
    slots: np.ndarray
    left: np.ndarray
    misses: int


class TileCache:
    """pages: that there are; slots: at least one more than there are `kept` pages, the first ones, which never leave.

    slot_of [pages], page_of [slots]: -1 if none. used [slots]: when, in an order of all uses.
    """

    def __init__(self, pages: int, slots: int, kept: int):
        self.slot_of = np.full(pages, -1)
        self.page_of = np.full(slots, -1)
        self.used = np.zeros(slots, np.int64)
        self.slot_of[:kept] = self.page_of[:kept] = np.arange(kept)
        self.kept, self.time = kept, 1

    def want(self, pages: np.ndarray, most: int | None = None) -> Changes:
        """Uses `pages`, each once, the most important ones first, and brings in those that are missing, `most` at most.

        If there are more than slots, the first ones come in, in place of later ones too: in which order pages were
        asked for before makes no difference, and nothing goes in and out while the same pages are wanted.
        """
        pages = pages[pages >= self.kept]
        chosen = pages[: len(self.page_of) - self.kept]
        self._use(pages[self.slot_of[pages] >= 0])
        missing = chosen[self.slot_of[chosen] < 0]
        new = missing[:most]
        slots = self._oldest(chosen)[: len(new)]
        left = self.page_of[slots]
        misses = int((self.slot_of[pages] < 0).sum())
        self.slot_of[left[left >= 0]] = -1
        self.slot_of[new], self.page_of[slots] = slots, new
        self._use(new)
        return Changes(new, slots, left, misses)

    def _oldest(self, chosen: np.ndarray) -> np.ndarray:
        """Slots that may be taken, free ones first."""
        may_go = np.ones(len(self.page_of), bool)
        may_go[: self.kept] = False
        may_go[self.slot_of[chosen[self.slot_of[chosen] >= 0]]] = False
        slots = np.flatnonzero(may_go)
        return slots[np.argsort(self.used[slots], kind="stable")]

    def _use(self, pages: np.ndarray) -> None:
        """The most important ones last."""
        self.used[self.slot_of[pages[::-1]]] = self.time + np.arange(len(pages))
        self.time += len(pages)

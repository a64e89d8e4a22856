"""The cache of tiles takes and gives as a plain model of one page after the other does."""

from collections import OrderedDict

import numpy as np
import pytest

from warp_neural.texture.tile_cache import TileCache


class Model:
    """Least recently used, one page after the other."""

    def __init__(self, slots, kept):
        self.slots, self.kept, self.pages = slots - kept, set(range(kept)), OrderedDict()

    def there(self, page):
        return page in self.kept or page in self.pages

    def want(self, pages, most):
        """(misses, decoded, evicted)"""
        pages = [page for page in pages if page not in self.kept]
        missing = [page for page in pages if page not in self.pages]
        for page in pages[::-1]:
            if page in self.pages:
                self.pages.move_to_end(page)
        chosen, evicted = pages[: self.slots], []
        decoded = [page for page in missing if page in chosen][:most]
        room = self.slots - len(self.pages)
        for _page in decoded[room:]:
            evicted.append(next(page for page in self.pages if page not in chosen))
            del self.pages[evicted[-1]]
        for page in decoded[::-1]:
            self.pages[page] = None
        return len(missing), decoded, evicted


@pytest.mark.parametrize("most", [None, 3])
def test_the_cache_is_that_of_a_plain_model(most):
    rng, model, cache_ = np.random.default_rng(1), Model(12, 3), TileCache(60, 12, 3)
    seen = set()
    for step in range(300):
        pages = np.sort(rng.choice(60, rng.integers(0, 20 if step % 3 else 5), replace=False))
        misses, decoded, evicted = model.want(list(pages), most)
        changes = cache_.want(pages, most)
        assert (changes.misses, list(changes.pages)) == (misses, decoded)
        assert list(changes.left[changes.left >= 0]) == evicted
        there = np.flatnonzero(cache_.slot_of >= 0)
        assert set(there) == model.kept | set(model.pages)
        assert (cache_.page_of[cache_.slot_of[there]] == there).all()
        seen.add((len(decoded) < misses, len(evicted) > 0))
    assert {(False, False), (False, True), (True, True)} <= seen


def test_if_not_all_fits_the_coarsest_are_there_and_stay():
    """Whatever was there before."""
    cache_ = TileCache(60, 12, 3)
    cache_.want(np.arange(30, 50))
    cache_.want(np.arange(5, 25), most=4)
    changes = [cache_.want(np.arange(5, 25)) for _ in range(2)][-1]
    assert list(np.flatnonzero(cache_.slot_of >= 0)) == [0, 1, 2, *range(5, 14)]
    assert changes.misses == 11 and len(changes.pages) == 0

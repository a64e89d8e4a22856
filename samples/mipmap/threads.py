"""Work in threads, which Ctrl-C ends at their next step."""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import takewhile
from threading import Event

import warp as wp

Going = Callable[[Iterable], Iterator]


@contextmanager
def threads(device: wp.Device) -> Iterator[tuple[ThreadPoolExecutor, Going]]:
    """As many as pay: a CPU launch runs on the thread that makes it, a GPU has one queue.

    `going(steps)` are the steps until the body ends by an exception (Ctrl-C); what has not begun then never does.
    """
    stopped = Event()
    pool = ThreadPoolExecutor(1 if device.is_cuda else min(2, os.cpu_count() or 1))
    try:
        yield pool, lambda steps: takewhile(lambda _step: not stopped.is_set(), steps)
    except BaseException:
        stopped.set()
        raise
    finally:
        pool.shutdown(cancel_futures=True)

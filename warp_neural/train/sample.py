"""The function that makes the samples of a `Trainer`: what is wrong with it, said of its own file and line."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import warp as wp

from warp_neural.errors import InputError
from warp_neural.kernels.errors import require
from warp_neural.kernels.nn.random import Stream
from warp_neural.nn.mlp import MLP

EXPECTED = "a @wp.func of (index: int, random: wn.random.Stream), and of a third argument that it reads as data"
PLACE = re.compile(r'Error while parsing function "([^"]*)" at (.*?):(\d+):\n')


def check_sample(sample: Any) -> None:
    """Its arguments; what it returns is known as it is compiled."""
    is_function = isinstance(sample, wp.Function) and not sample.is_builtin()
    types = list(sample.input_types.values()) if is_function else []
    right = len(types) in (2, 3) and types[0] in (int, wp.int32) and types[1] is Stream
    if is_function and not right:
        raise InputError(f"sample={place_of(sample)}: takes {sample!s}; expected {EXPECTED}")
    require(right, "sample", getattr(sample, "__name__", sample), EXPECTED)


def place_of(sample: wp.Function) -> str:
    code = sample.func.__code__
    return f"{sample.func.__name__} ({code.co_filename}:{code.co_firstlineno})"


@contextmanager
def explained(sample: wp.Function, net: MLP) -> Iterator[None]:
    """Warp's errors while it reads `sample` become one line: of what it returns, or of the line it stumbled over."""
    try:
        yield
    except Exception as error:
        places = list(PLACE.finditer(str(error)))
        if isinstance(error, InputError) or not places:
            raise
        why = " ".join(str(error)[places[-1].end() :].split("\n;", 1)[-1].split())
        names = [found[1] for found in places]
        if sample.func.__name__ in names:  # within it, or what it calls
            raise InputError(f"sample={place_of(sample)}: {places[-1][2]}:{places[-1][3]}: {why}") from None
        wanted = f"(x: a vector of {net.n_in} {net.spec.dtype.__name__}, target: a vector of {net.n_out} float32)"
        raise InputError(f"sample={place_of(sample)}: expected to return {wanted} ({why})") from None

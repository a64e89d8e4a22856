"""What tests of RTXNS's two forms share: networks, their comparison, and what a parser may do with damaged bytes."""

from itertools import pairwise

import numpy as np
from hypothesis import HealthCheck, settings

from warp_neural.errors import InputError
from warp_neural.io.rtxns import RtxnsNetwork

quiet = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)


def network(sizes=(5, 16, 16, 3), dtype=np.float16, seed=0, extra=None):
    rng = np.random.default_rng(seed)
    weights = [rng.normal(size=(n, k)).astype(dtype) for k, n in pairwise(sizes)]
    return RtxnsNetwork(weights, [rng.normal(size=n).astype(dtype) for n in sizes[1:]], extra or {})


def same(a, b):
    assert a.sizes == b.sizes and a.extra == b.extra
    for x, y in zip(a.weights + a.biases, b.weights + b.biases, strict=True):
        assert x.dtype == y.dtype and x.shape == y.shape and x.tobytes() == y.tobytes()


def check(read, path, content):
    path.write_bytes(content)
    try:
        net = read(path)
    except InputError as error:
        assert str(error).startswith(f"{path}: ") and "\n" not in str(error)
        return
    sizes = net.sizes
    assert [w.shape for w in net.weights] == list(zip(sizes[1:], sizes, strict=False))
    assert all(np.isfinite(array).all() for array in net.weights + net.biases)
    assert sum(array.size for array in net.weights) <= len(content)

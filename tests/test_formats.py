"""Number formats against ml_dtypes and NumPy, code by code."""

import ml_dtypes
import numpy as np
import pytest
import reference_networks as reference
import warp as wp

from warp_neural import MLP
from warp_neural.kernels.coopvec.formats import make_decode, make_encode
from warp_neural.kernels.coopvec.layout import make_pack_kernel, network_layout
from warp_neural.kernels.nn.spec import FORMATS, NetworkSpec

NAMES = list(FORMATS)
ENCODE, DECODE = [make_encode(f) for f in FORMATS.values()], [make_decode(f) for f in FORMATS.values()]
TYPES = {**reference.FORMATS, "int8": np.int8}


@wp.kernel(module="unique", enable_backward=False)
def encode_kernel(x: wp.array[float], codes: wp.array2d[wp.uint32]):
    i = wp.tid()
    for f in range(wp.static(len(NAMES))):
        codes[f, i] = wp.static(ENCODE[f])(x[i])


@wp.kernel(module="unique", enable_backward=False)
def decode_kernel(codes: wp.array[wp.uint32], x: wp.array2d[float]):
    i = wp.tid()
    for f in range(wp.static(len(NAMES))):
        x[f, i] = wp.static(DECODE[f])(codes[i])


def encode(x, format, device):
    codes = wp.empty((len(NAMES), len(x)), dtype=wp.uint32, device=device)
    wp.launch(encode_kernel, len(x), [wp.array(x, dtype=float, device=device), codes], device=device)
    return codes.numpy()[NAMES.index(format)]


def decode(codes, format, device):
    x = wp.empty((len(NAMES), len(codes)), dtype=float, device=device)
    wp.launch(decode_kernel, len(codes), [wp.array(codes, dtype=wp.uint32, device=device), x], device=device)
    return x.numpy()[NAMES.index(format)]


def values():
    """Random numbers over all magnitudes, every value of the small formats, the ties between them, and the edges."""
    rng = np.random.default_rng(0)
    with np.errstate(over="ignore"):
        random = rng.normal(size=20000) * 2.0 ** rng.integers(-60, 60, 20000)
    small = [np.arange(256, dtype=np.uint8).view(TYPES[f]).astype(np.float32) for f in ("e4m3", "e5m2")]
    small.append(np.arange(65536, dtype=np.uint16).view(np.float16).astype(np.float32))
    exact = np.unique(np.hstack(small)[np.isfinite(np.hstack(small))])
    ties = (exact[1:] + exact[:-1]) / 2
    edges = [0.0, -0.0, np.inf, -np.inf, 3.4e38, -3.4e38, 1e-45, 127.5, -127.5, 126.5, 65519.0, 65520.0, 464.0, 465.0]
    return np.hstack([random, exact, ties, edges]).astype(np.float32)


@pytest.mark.parametrize("format", TYPES)
def test_every_code_decodes(format, device):
    bits = FORMATS[format].bits
    codes = np.arange(2**bits, dtype=np.uint32)
    expected = codes.astype(f"uint{bits}").view(TYPES[format]).astype(np.float32)
    np.testing.assert_array_equal(decode(codes, format, device), expected)


@pytest.mark.parametrize("format", FORMATS)
def test_encode_rounds_to_nearest_even(format, device):
    x = values()
    if format in ("float32", "tf32"):
        x = x[np.isfinite(x)]
    if format == "tf32":
        x = x[np.abs(x) < 3.4e38]
    with np.errstate(over="ignore"):
        expected = reference.rounded(x, format)
    np.testing.assert_array_equal(decode(encode(x, format, device), format, device), expected)


@pytest.mark.parametrize("format", ["float32", "tf32", "float16", "bfloat16", "e4m3", "e5m2"])
def test_nan_stays_nan(format, device):
    nan = np.array([0x7FC00000, 0x7FFFFFFF, 0xFFFFFFFF, 0x7F800001], np.uint32).view(np.float32)
    assert np.isnan(decode(encode(nan, format, device), format, device)).all()


@pytest.mark.parametrize("format", ["e4m3", "e5m2"])
def test_8_bit_formats_saturate(format, device):
    largest = float(ml_dtypes.finfo(TYPES[format]).max)
    x = np.array([largest * 1.5, 1e30, np.inf, -np.inf], np.float32)
    assert decode(encode(x, format, device), format, device).tolist() == [largest] * 3 + [-largest]
    assert FORMATS[format].largest == largest


@pytest.mark.parametrize("format", FORMATS)
def test_packed_for_the_cpu(format):
    """Rounded weights lie [n_in, n_out], rows padded with zeros to 16; biases after them, unrounded."""
    net = MLP(5, 3, 17, 1, precision=format, count=2, device="cpu")
    net.biases = [np.random.default_rng(0).normal(size=b.shape) for b in net.biases]
    packed = net.packed.numpy().view(np.float32).reshape(2, -1)
    for layer, part in enumerate(network_layout(net.spec, False)[0]):
        stored = packed[:, part.weights : part.bias].reshape(2, part.k, part.n_pad)
        steps = net.steps.numpy()[:, layer, 1, None, None]
        expected = reference.rounded(net.weights[layer] / steps, format)
        np.testing.assert_array_equal(stored[:, :, : part.n].transpose(0, 2, 1), expected)
        assert not stored[:, :, part.n :].any()
        np.testing.assert_array_equal(packed[:, part.bias : part.bias + part.n], net.biases[layer])


def test_kernels_are_shared():
    format = FORMATS["float16"]
    assert make_pack_kernel(format, False, False) is make_pack_kernel(format, False, False)
    assert network_layout(NetworkSpec((3, 4)), False) is network_layout(NetworkSpec((3, 4)), False)

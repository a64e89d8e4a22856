"""Layouts of one matrix, and conversion between them and between precisions."""

import os

import numpy as np
import pytest
import reference_networks as reference
import warp as wp
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from warp_neural import InputError
from warp_neural.coopvec import convert_matrix, matrix_size, pack_matrix, unpack_matrix
from warp_neural.kernels.coopvec.convert import convert_kernel, make_element_index
from warp_neural.kernels.coopvec.layout import layer_table, make_pack_kernel, network_layout
from warp_neural.kernels.nn.spec import FORMATS, NetworkSpec

LAYOUTS = ["row_major", "column_major", "inferencing_optimal", "training_optimal"]
# one K block of the B operand (PTX ISA): axes of k from slow to fast, and their order in the words of a lane
FRAGMENT = {32: ((4, 2), (0, 1)), 16: ((2, 4, 2), (1, 0, 2)), 8: ((2, 2, 4, 2), (2, 0, 1, 3))}


def rounded(values, precision):
    x = reference.rounded(values, precision)
    return x + 0 if precision == "int8" else x  # which has no -0


def codes(values, precision):
    """The bits of `values` in a precision, as the unsigned integers of its size."""
    x = rounded(values, precision)
    types = {"float32": np.float32, "tf32": np.float32, "int8": np.int8, **reference.FORMATS}
    return x.astype(types[precision]).view(f"u{FORMATS[precision].bits // 8}")


def padded(matrix, rows, columns):
    n, k = matrix.shape
    return np.pad(matrix, ((0, -n % rows), (0, -k % columns)))


def stored(matrix, precision, layout):
    """Elements [rows, columns] in the order of a tight layout, by reshaping."""
    if layout == "row_major":
        return matrix.ravel()
    if layout == "column_major":
        return matrix.T.ravel()
    if layout == "training_optimal":
        m = padded(matrix, 16, 8)
        m = m.reshape(m.shape[0] // 16, 2, 8, m.shape[1] // 8, 4, 2)  # tile, half, g, tile, t, column of a pair
        return m.transpose(0, 3, 2, 4, 1, 5).ravel()
    if precision == "float32":
        return padded(matrix, 1, 4).ravel()
    axes, lane = FRAGMENT[FORMATS[precision].bits]
    step = int(np.prod(axes))
    m = padded(matrix, 8, 2 * step)
    m = m.reshape(m.shape[0] // 8, 8, m.shape[1] // (2 * step), 2, *axes)  # tile, g, pair, K block of the pair, ...
    t, *rest = (4 + axis for axis in lane)
    return m.transpose(0, 2, 1, t, 3, *rest).ravel()


def as_words(elements):
    raw = np.frombuffer(elements.tobytes(), np.uint8)
    return np.pad(raw, (0, -len(raw) % 16)).view(np.uint32)


def matrix(rows, columns, seed=0):
    return np.random.default_rng(seed).normal(size=(rows, columns), scale=20).astype(np.float32)


def test_twin_of_fragments():
    """The reshaping against PTX ISA's words for the B operand of m16n8k16, lane 4 g + t: (n = g, k = 2 t + 8 r)."""
    w = np.arange(8 * 32).reshape(8, 32)
    pairs = stored(w, "float16", "inferencing_optimal").reshape(32, 2, 2, 2)  # lane, K block, register, element
    for lane in range(32):
        for block, register in np.ndindex(2, 2):
            k = 16 * block + 2 * (lane % 4) + 8 * register
            assert pairs[lane, block, register].tolist() == w[lane // 4, k : k + 2].tolist()


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("precision", FORMATS)
def test_pack(precision, layout, device):
    """Bit for bit, padding included, on host and device; sizes are those of the twin."""
    for rows, columns in [(1, 1), (3, 5), (8, 16), (16, 8), (17, 33), (64, 64), (70, 69)]:
        values = matrix(rows, columns)
        expected = as_words(stored(codes(values, precision), precision, layout))
        assert matrix_size(rows, columns, precision, layout) == expected.nbytes
        packed = pack_matrix(values, precision, layout, device)
        assert packed.device == device
        np.testing.assert_array_equal(packed.numpy(), expected)
        if device.is_cpu:
            np.testing.assert_array_equal(pack_matrix(values, precision, layout), expected)
        unpacked = unpack_matrix(packed, rows, columns, precision, layout)
        np.testing.assert_array_equal(unpacked, rounded(values, precision))


stores = st.tuples(st.sampled_from(list(FORMATS)), st.sampled_from(LAYOUTS))


@settings(
    max_examples=int(os.environ.get("WARP_NEURAL_EXAMPLES", "100")),
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(rows=st.integers(1, 70), columns=st.integers(1, 70), source=stores, target=stores, seed=st.integers(0, 1000))
def test_any_to_any(device, rows, columns, source, target, seed):
    """Between all layouts and precisions, rounding as ml_dtypes does; and back again."""
    values = rounded(matrix(rows, columns, seed), source[0])
    words = as_words(stored(codes(values, source[0]), *source))
    expected = as_words(stored(codes(values, target[0]), *target))
    there = convert_matrix(wp.array(words, device=device), rows, columns, *source, *target)
    np.testing.assert_array_equal(there.numpy(), expected)
    back = convert_matrix(there, rows, columns, *target, *source)
    again = rounded(rounded(values, target[0]), source[0])
    np.testing.assert_array_equal(back.numpy(), as_words(stored(codes(again, source[0]), *source)))


@pytest.mark.parametrize("precision", ["tf32", "float16", "e4m3"])
def test_same_as_in_networks(precision, device):
    """Inferencing optimal is what `make_pack_kernel` makes of a layer for tensor cores; one format of each size."""
    spec = NetworkSpec((37, 19), format=FORMATS[precision])
    values = matrix(19, 37)
    (layer,), words = network_layout(spec, True)
    packed = wp.zeros(words, dtype=wp.uint32, device=device)
    table = wp.array(layer_table(spec, True), dtype=int, device=device)
    master = wp.array(np.hstack([values.ravel(), np.zeros(19)]), dtype=float, device=device)
    inputs = [table, wp.ones((1, 1, 2), dtype=float, device=device), master, spec.n_parameters, packed, words]
    wp.launch(make_pack_kernel(spec.format, True, False), (1, words), inputs, device=device)
    expected = pack_matrix(values, precision, "inferencing_optimal")
    np.testing.assert_array_equal(packed.numpy()[layer.weights : layer.bias], expected)


@pytest.mark.parametrize("layout", ["row_major", "column_major"])
@pytest.mark.parametrize("precision", ["float32", "float16", "e4m3"])
def test_strides_and_offsets(precision, layout, device):
    """Into the middle of a buffer, whose other bytes stay, and out of it."""
    values, size = matrix(5, 7), FORMATS[precision].bits // 8
    lines = (values if layout == "row_major" else values.T).shape
    stride, offset = 9 * size, 20
    target = wp.full(256, 0xABABABAB, dtype=wp.uint32, device=device)
    expected = np.full(1024, 0xAB, np.uint8)
    view = expected[offset : offset + lines[0] * stride].view(f"u{size}").reshape(lines[0], 9)[:, : lines[1]]
    view[...] = codes(values, precision) if layout == "row_major" else codes(values, precision).T
    at = {"target": target, "target_stride": stride, "target_offset": offset}
    assert convert_matrix(values, 5, 7, "float32", "row_major", precision, layout, **at) is target
    np.testing.assert_array_equal(target.numpy().view(np.uint8), expected)
    at = {"source_stride": stride, "source_offset": offset}
    tight = convert_matrix(target, 5, 7, precision, layout, precision, "inferencing_optimal", **at)
    np.testing.assert_array_equal(tight.numpy(), pack_matrix(values, precision, "inferencing_optimal"))
    assert matrix_size(5, 7, precision, layout, stride) == -(-((lines[0] - 1) * stride + lines[1] * size) // 16) * 16


def test_zeroes_its_padding(device):
    """Also where the target held something before."""
    for layout in ("inferencing_optimal", "training_optimal"):
        expected = pack_matrix(matrix(3, 5), "float16", layout)
        target = wp.full(len(expected) + 8, 0xABABABAB, dtype=wp.uint32, device=device)
        convert_matrix(matrix(3, 5), 3, 5, "float32", "row_major", "float16", layout, target=target, target_offset=16)
        np.testing.assert_array_equal(target.numpy(), np.pad(expected, 4, constant_values=0xABABABAB))


def test_array_types(device):
    """Elements as well as words; NumPy arrays of any length, since they are copied."""
    values = matrix(3, 3)
    expected = pack_matrix(values, "float16", "column_major")
    half = values.astype(np.float16)
    same = convert_matrix(half, 3, 3, "float16", "row_major", "float16", "column_major")
    np.testing.assert_array_equal(same, expected)
    target = np.zeros((3, 3), np.float16)
    master = wp.array(values, dtype=float, device=device)
    convert_matrix(master, 3, 3, "float32", "row_major", "float16", "row_major", target=target)
    np.testing.assert_array_equal(target, half)
    pair = wp.zeros((2, 3), dtype=wp.float16, device=device)
    convert_matrix(values[:2], 2, 3, "float32", "row_major", "float16", "row_major", target=pair)
    np.testing.assert_array_equal(pair.numpy(), half[:2])


def test_graph(device):
    """On CUDA the conversion replays in a graph."""
    source = wp.array(matrix(20, 30), dtype=float, device=device)
    target = wp.zeros(matrix_size(20, 30, "e4m3", "training_optimal") // 4, dtype=wp.uint32, device=device)
    convert = [source, 20, 30, "float32", "row_major", "e4m3", "training_optimal"]
    convert_matrix(*convert, target=target)
    if device.is_cuda:
        with wp.ScopedCapture(device) as capture:
            convert_matrix(*convert, target=target)
    source.assign(matrix(20, 30, seed=1))
    if device.is_cuda:
        wp.capture_launch(capture.graph)
    else:
        convert_matrix(*convert, target=target)
    np.testing.assert_array_equal(target.numpy(), pack_matrix(matrix(20, 30, seed=1), "e4m3", "training_optimal"))


def test_element_index(device):
    """What device code that reads a stored matrix itself calls."""
    index = make_element_index("training_optimal", FORMATS["float32"])

    @wp.kernel(module="unique", enable_backward=False)
    def read_kernel(stored: wp.array[float], values: wp.array2d[float]):
        n, k = wp.tid()
        values[n, k] = stored[index(n, k, values.shape[0], values.shape[1], 0)]

    packed = wp.array(stored(matrix(20, 30), "float32", "training_optimal"), dtype=float, device=device)
    values = wp.zeros((20, 30), dtype=float, device=device)
    wp.launch(read_kernel, values.shape, [packed, values], device=device)
    np.testing.assert_array_equal(values.numpy(), matrix(20, 30))


def test_compiles_for_hopper(tmp_path):
    (artifact,) = wp.compile_aot_module(convert_kernel.module, arch=90, module_dir=tmp_path)
    assert artifact.stat().st_size > 0


ROW = ("row_major", "float16", "row_major")
REFUSED = [
    ((0, 3, "float16", *ROW), {}, "rows=0: expected a whole number of 1 to 256"),
    ((3, 257, "float16", *ROW), {}, "columns=257"),
    ((3, 5, "float8", *ROW), {}, "source precision='float8': expected one of float32, tf32"),
    ((3, 5, "float16", "row_major", "float16", "optimal"), {}, "target layout='optimal': expected one of row_major"),
    ((3, 5, "float16", *ROW), {"source_stride": 8}, "source stride 8: expected 0 .tight. or a multiple of 2 from 10"),
    ((3, 5, "float16", *ROW), {"target_stride": 11}, "target stride 11"),
    ((3, 5, "float16", "training_optimal", *ROW[1:]), {"source_stride": 16}, "training_optimal has none"),
    ((3, 5, "float16", *ROW), {"source_offset": 2}, "source offset 2: expected a multiple of 4"),
    ((3, 5, "float16", *ROW), {"source_offset": -4}, "source offset=-4"),
    ((3, 5, "float16", "training_optimal", *ROW[1:]), {"source_offset": 8}, "offset 8: expected a multiple of 16"),
    ((5, 5, "float16", *ROW), {}, "source buffer of 32 bytes: a 5 x 5 matrix of float16, row_major, ends at byte 52"),
    ((3, 5, "float16", *ROW), {"source_offset": 4}, "source buffer of 32 bytes"),
    ((3, 5, "float16", *ROW), {"target": np.zeros(7, np.uint32)}, "target buffer of 28 bytes"),
    ((3, 5, "bfloat16", *ROW), {}, "source buffer of float16: bfloat16 is held by uint32, uint8, bfloat16"),
    ((3, 5, "float16", *ROW), {"target": np.zeros(9)}, "target buffer of float64"),
]  # fmt: skip


@pytest.mark.parametrize(("arguments", "options", "message"), REFUSED)
def test_refuses(arguments, options, message):
    with pytest.raises(InputError, match=message):
        convert_matrix(np.zeros(16, np.float16), *arguments, **options)


def test_refuses_arrays(device):
    arguments = 3, 5, "float32", "row_major", "float16", "row_major"
    with pytest.raises(InputError, match="contiguous"):
        convert_matrix(wp.zeros((3, 10), dtype=float, device=device)[:, ::2], *arguments)
    with pytest.raises(InputError, match="source buffer of vec2f"):
        convert_matrix(wp.zeros((3, 5), dtype=wp.vec2, device=device), *arguments)
    with pytest.raises(InputError, match=r"values: shape \(3,\); expected \[rows, columns\]"):
        pack_matrix(np.zeros(3), "float16", "row_major")

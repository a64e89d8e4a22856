"""Orders of elements in memory: against the PTX ISA's tables, and what follows from them against each other."""

import numpy as np
import pytest
import warp as wp

from warp_neural.kernels.coopvec import fragment_layout
from warp_neural.kernels.coopvec.convert import LAYOUTS, matrix_elements, matrix_layout
from warp_neural.kernels.coopvec.fragment_layout import Text, accumulators, operands, warpgroup_accumulators
from warp_neural.kernels.coopvec.layout import bias_is_half, layer_table, make_pack_kernel, network_layout
from warp_neural.kernels.nn.spec import BFLOAT16, E4M3, FLOAT16, FLOAT32, TF32, NetworkSpec
from warp_neural.kernels.training.hopper64 import schedule as hopper64
from warp_neural.kernels.training.hopper128 import schedule as hopper128
from warp_neural.kernels.training.mma import schedule as mma
from warp_neural.train.layout import fragment_order, packed_targets

MATRICES = {
    "row_major": fragment_layout.row_major,
    "column_major": fragment_layout.column_major,
    **{format.name: lambda rows, columns, f=format: operands(f, rows, columns) for format in (TF32, FLOAT16, E4M3)},
    "accumulators": accumulators,
    "warpgroup accumulators": warpgroup_accumulators,
}
VECTORS = {"biases": fragment_layout.biases, "half biases": fragment_layout.half_biases}
SIZES = [(1, 1), (3, 5), (8, 64), (17, 33), (64, 64), (128, 72), (70, 129)]
LANE = np.arange(32)
G, T = LANE // 4, LANE % 4


@pytest.mark.parametrize("make", MATRICES.values(), ids=MATRICES)
@pytest.mark.parametrize("sizes", SIZES)
def test_every_place_once(make, sizes):
    """Padding to whole tiles included."""
    layout = make(*sizes)
    i = np.arange(layout.elements)
    n, k = layout.place(i)
    np.testing.assert_array_equal(layout.index(n, k), i)
    assert len(set(zip(n.tolist(), k.tolist(), strict=True))) == layout.elements
    rows, columns = n.max() + 1, k.max() + 1
    assert rows * columns == layout.elements and rows >= sizes[0] and columns >= sizes[1]
    assert make(rows, columns).elements == layout.elements


@pytest.mark.parametrize("make", VECTORS.values(), ids=VECTORS)
@pytest.mark.parametrize("size", [1, 16, 31, 64, 130])
def test_every_element_of_a_vector_once(make, size):
    layout = make(size)
    i = np.arange(layout.elements)
    (n,) = layout.place(i)
    np.testing.assert_array_equal(layout.index(n), i)
    assert sorted(n) == i.tolist() and layout.elements >= size


def evaluated(text, **names):
    return eval(str(text).replace("/", "//"), {}, names)  # of what is not negative, C++ rounds alike


@pytest.mark.parametrize("make", MATRICES.values(), ids=MATRICES)
def test_text_of_a_matrix(make):
    """Sizes as numbers or, as for a kernel of matrices of any size, as names."""
    rows, columns = 70, 129
    layout, of_names = make(rows, columns), make(Text("rows"), Text("columns"))
    sizes = {"rows": rows, "columns": columns}
    i = np.arange(layout.elements)
    n, k = layout.place(i)
    for text in (make(rows, columns), of_names):
        np.testing.assert_array_equal(evaluated(text.index(Text("n"), Text("k")), n=n, k=k, **sizes), i)
        for axis, coordinate in zip(text.place(Text("i")), (n, k), strict=True):
            np.testing.assert_array_equal(evaluated(axis, i=i, **sizes), coordinate)
    assert evaluated(of_names.elements, **sizes) == layout.elements


@pytest.mark.parametrize("make", VECTORS.values(), ids=VECTORS)
def test_text_of_a_vector(make):
    layout = make(130)
    n = np.arange(130)
    np.testing.assert_array_equal(evaluated(layout.index(Text("n")), n=n), layout.index(n))
    (text,) = layout.place(Text("i"))
    np.testing.assert_array_equal(evaluated(text, i=layout.index(n)), n)


def test_operands_of_16_bits():
    """PTX ISA, m16n8k16, elements b0 to b3 of B: row 2 t + i % 2, 8 more for i >= 2, column g."""
    layout = operands(FLOAT16, 24, 96)  # three tiles of rows, three pairs of K blocks
    for tile, pair, half, i in np.ndindex(3, 3, 2, 4):
        k = 2 * T + i % 2 + (8 if i >= 2 else 0)
        index = ((tile * 3 + pair) * 32 + LANE) * 8 + half * 4 + i
        np.testing.assert_array_equal(layout.index(8 * tile + G, 16 * (2 * pair + half) + k), index)


def test_operands_of_8_bits():
    """PTX ISA, m16n8k32, elements b0 to b7 of B: row 4 t + i % 4, 16 more for i >= 4, column g.

    There lies what a lane has of vectors in accumulators: columns 2 t and 2 t + 1 of one tile, then of the next.
    """
    layout = operands(E4M3, 16, 128)
    for tile, pair, half, i in np.ndindex(2, 2, 2, 8):
        k = 8 * (i // 2) + 2 * T + i % 2
        index = ((tile * 2 + pair) * 32 + LANE) * 16 + half * 8 + i
        np.testing.assert_array_equal(layout.index(8 * tile + G, 32 * (2 * pair + half) + k), index)


def test_operands_of_tf32():
    """PTX ISA, m16n8k8, elements b0 and b1 of B: rows t and t + 4, column g, where accumulators have 2 t, 2 t + 1."""
    layout = operands(TF32, 16, 32)
    for tile, pair, half, i in np.ndindex(2, 2, 2, 2):
        index = ((tile * 2 + pair) * 32 + LANE) * 4 + half * 2 + i
        np.testing.assert_array_equal(layout.index(8 * tile + G, 8 * (2 * pair + half) + 2 * T + i), index)


@pytest.mark.parametrize("format", [TF32, FLOAT16, E4M3], ids=lambda format: format.name)
def test_operands_by_units(format):
    """As device text goes through them: 16-byte units of lanes, registers in a unit, elements in a register."""
    layout = operands(format, 24, 128)
    (rows, columns), memory = layout.axes, layout.memory
    element, word = memory.only("e", "upper"), memory.only("register", "half")
    unit = memory.only("t", "g", "pair", "tile")
    for e, r, i in np.ndindex(format.per_word, 4, layout.elements // (4 * format.per_word)):
        digits = element.split(e) | word.split(r) | unit.split(i)
        assert unit.join(**rows.split(rows.join(**digits)), t=digits["t"], pair=digits["pair"]) == i
        place = rows.join(**digits), columns.join(**digits)
        assert layout.index(*place) == (4 * i + r) * format.per_word + e


def test_accumulators():
    """PTX ISA, m16n8, c0 to c3: row g, 8 more for i >= 2; column 2 t + i % 2."""
    layout = accumulators(48, 24)
    for block, tile, i in np.ndindex(3, 3, 4):
        n, k = 16 * block + G + (8 if i >= 2 else 0), 8 * tile + 2 * T + i % 2
        np.testing.assert_array_equal(layout.index(n, k), (block * 3 + tile) * 128 + 4 * LANE + i)


def test_accumulators_of_warpgroups():
    """PTX ISA, wgmma m64nN, d: row 16 warp + g, 8 more for odd i / 2; column 8 (i / 4) + 2 t + i % 2."""
    layout = warpgroup_accumulators(128, 40)
    for part, warp, i in np.ndindex(2, 4, 20):
        n, k = 64 * part + 16 * warp + G + 8 * (i // 2 % 2), 8 * (i // 4) + 2 * T + i % 2
        np.testing.assert_array_equal(layout.index(n, k), (part * 20 + i) * 128 + 32 * warp + LANE)


def test_biases():
    """16 bytes of a lane: columns 2 t and 2 t + 1 of two tiles as float32, of four as float16."""
    for make, tiles in ((fragment_layout.biases, 2), (fragment_layout.half_biases, 4)):
        for rest, tile, e in np.ndindex(2, tiles, 2):
            n = 8 * (rest * tiles + tile) + 2 * np.arange(4) + e
            np.testing.assert_array_equal(make(64).index(n), (rest * 4 + np.arange(4)) * 2 * tiles + tile * 2 + e)


def test_size_of_a_matrix():
    assert matrix_elements("inferencing_optimal", FLOAT16, 9, 33) == 16 * 64
    assert matrix_elements("inferencing_optimal", E4M3, 9, 33) == 16 * 64
    assert matrix_elements("inferencing_optimal", TF32, 9, 33) == 16 * 48
    assert matrix_elements("inferencing_optimal", FLOAT32, 9, 33) == 9 * 36
    assert matrix_elements("training_optimal", FLOAT16, 17, 33) == 32 * 40
    for layout in LAYOUTS:
        assert matrix_elements(layout, FLOAT16, 16, 32) == matrix_layout(layout, FLOAT16, 16, 32).elements == 512


@pytest.mark.parametrize("accumulation", ["float32", "float16"])
@pytest.mark.parametrize("sizes", [(1, 1), (40, 64, 64, 3), (33, 128, 17), (5, 16, 24, 32, 9)])
def test_packed_targets(sizes, accumulation, device):
    """Each parameter, by its number, is where the packing kernel puts it; all else is zero."""
    spec = NetworkSpec(sizes, accumulation=accumulation)
    (layers, words), half = network_layout(spec, True), bias_is_half(spec, True)
    table = wp.array(layer_table(spec, True), dtype=int, device=device)
    steps = wp.ones((1, len(layers), 2), dtype=float, device=device)
    numbers, targets = np.arange(spec.n_parameters), packed_targets(spec)
    for digits in (numbers % 1000 + 1, numbers // 1000 + 1):  # which float16 holds exactly
        packed = wp.zeros(words, dtype=wp.uint32, device=device)
        inputs = [table, steps, wp.array(digits, dtype=float, device=device), spec.n_parameters, packed, words]
        wp.launch(make_pack_kernel(spec.format, True, half), (1, words), inputs, device=device)
        packed = packed.numpy()
        weights = targets >= 0
        np.testing.assert_array_equal(packed.view(np.float16)[targets[weights]], digits[weights])
        np.testing.assert_array_equal(packed.view(np.float32)[~targets[~weights]], digits[~weights])
        packed.view(np.uint16)[targets[weights]] = 0
        packed[~targets[~weights]] = 0
        assert not packed.any()


def places(schedule, layer):
    """(n, k) of each float of a layer's weights: the loops of the PTX ISA's tables, written out."""
    n_pad, k_pad = layer.layout.n_pad, layer.layout.k_pad
    if isinstance(schedule, mma.MmaSchedule):  # m16n8
        for block in range(-(-n_pad // 16)):
            for tile in range(k_pad // 8):
                for lane in range(32):
                    for c in range(4):
                        yield 16 * block + lane // 4 + c // 2 * 8, 8 * tile + lane % 4 * 2 + c % 2
        return
    rows, columns = (k_pad, n_pad) if layer.last else (n_pad, k_pad)
    for part in range(-(-rows // 64)):
        for d in range(columns // 2):
            for thread in range(128):
                row = 64 * part + thread // 32 * 16 + thread % 32 // 4 + d // 2 % 2 * 8
                column = d // 4 * 8 + thread % 4 * 2 + d % 2
                yield (column, row) if layer.last else (row, column)


SCHEDULED = [
    (mma, (1, 1)),
    (mma, (40, 16, 16, 3)),
    (mma, (3, 48, 32, 17)),
    (mma, (64, 64, 64, 64, 16)),
    (hopper64, (3, 64, 1)),
    (hopper64, (64, 64, 64, 64, 16)),
    (hopper64, (40, 64, 64, 9)),
    (hopper128, (70, 128, 9)),
    (hopper128, (5, 128, 128, 1)),
    (hopper128, (128, 128, 128, 128, 16)),
]


@pytest.mark.parametrize("room, sizes", SCHEDULED)
def test_order_of_block_sums(room, sizes):
    """Every parameter once, where the tables say, and nothing else."""
    spec = NetworkSpec(sizes, format=BFLOAT16)
    schedule = room.make_schedule(spec)
    order = fragment_order(schedule)
    for layer, first, (k, n) in zip(schedule.layers, spec.offsets, spec.layers, strict=True):
        of_weights = list(places(schedule, layer))
        expected = [first + row * k + column if row < n and column < k else -1 for row, column in of_weights]
        assert order[layer.first : layer.bias_first].tolist() == expected
        assert order[layer.bias_first :][:n].tolist() == list(range(first + n * k, first + n * k + n))

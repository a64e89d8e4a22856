"""How blocks share fused training steps on CUDA, as data: memory, registers, and who computes which gradient."""

from itertools import combinations

import numpy as np
import pytest

from warp_neural.kernels.nn import activations
from warp_neural.kernels.nn.spec import BFLOAT16, E4M3, FLOAT32, NetworkSpec, round_up
from warp_neural.kernels.training.hopper64 import schedule as hopper64
from warp_neural.kernels.training.hopper128 import schedule as hopper128
from warp_neural.kernels.training.mma import schedule as mma
from warp_neural.kernels.training.rooms import ROOMS, choose_schedule, room_of
from warp_neural.kernels.training.schedule import SPARE_BYTES, Schedule, ScheduledLayer
from warp_neural.train.layout import fragment_order

ARCHS, SHARED = (75, 80, 89, 90, 100, 120), (48, 99, 163, 227)  # of GPUs, and KB of shared memory of their blocks


def spec(n_in, width, depth, n_out, **options):
    return NetworkSpec((n_in, *[width] * depth, n_out), **options)


MMA = [spec(width if depth % 2 else 3, width, depth, 16 - depth) for width in range(1, 129) for depth in range(6)]
HOPPER64 = [spec(n_in, 64, depth, n_out) for depth in (1, 2, 3) for n_in, n_out in ((64, 16), (3, 1), (40, 9))]
HOPPER128 = [spec(n_in, 128, depth, n_out) for depth in (1, 2, 3) for n_in, n_out in ((128, 16), (5, 1), (70, 9))]


def schedules(make_schedule, specs):
    """Those that there are, with their networks."""
    return [(one, made) for one in specs if (made := make_schedule(one))]


def expect_apart(regions):
    """regions: (start, size, first time, last time). Those that live at one time do not overlap."""
    for (a, size_a, *times_a), (b, size_b, *times_b) in combinations(regions, 2):
        if max(times_a[0], times_b[0]) <= min(times_a[1], times_b[1]):
            assert a + size_a <= b or b + size_b <= a


def expect_whole(made: Schedule, network: NetworkSpec):
    """Every parameter has one place in a block's sums, weights before biases, layer after layer."""
    order = fragment_order(made)
    np.testing.assert_array_equal(np.sort(order[order >= 0]), np.arange(network.n_parameters))
    ends = [layer.first for layer in made.layers[1:]] + [made.floats]
    for layer, end in zip(made.layers, ends, strict=True):
        assert layer.first < layer.bias_first < end and end - layer.bias_first >= layer.layout.n


@pytest.mark.parametrize("room", ROOMS, ids=lambda room: room.schedule.__name__)
def test_a_room_keeps_the_protocol(room):
    made = next(made for one in (*HOPPER64, *HOPPER128, *MMA) if (made := room.make_schedule(one, 90, 227 << 10)))
    assert room_of(made) is room and made.threads % 32 == 0 and made.round_samples == made.threads * made.lanes // 32
    for name in Schedule.__annotations__:
        assert getattr(made, name) is not None or name == "lower"
    for layer in made.layers:
        assert all(hasattr(layer, name) for name in ScheduledLayer.__annotations__)
    assert made.block_sums >= made.floats + 1
    if made.lower:
        assert room.make_lower_texts and made.kept_units(132, 1 << 16) > 0


# network, options; then the room on Hopper, and the least shared memory in KB with which it trains, there and elsewhere
CHOICES = [
    ((64, 64, 3, 16), {}, "Hopper64", 227, 163),
    ((64, 64, 3, 16), {"format": BFLOAT16, "activation": activations.leaky_relu}, "Hopper64", 227, 163),
    ((64, 64, 3, 16), {"activation": activations.elu}, "Hopper64", 227, 163),
    ((64, 64, 3, 16), {"activation": activations.gelu}, "Mma", 163, 163),
    ((64, 64, 4, 16), {}, "Mma", 163, 163),
    ((64, 64, 3, 17), {}, "Mma", 163, 163),
    ((32, 32, 3, 4), {}, "Mma", 99, 99),
    ((16, 16, 3, 3), {}, "Mma", 48, 48),
    ((128, 128, 3, 16), {}, "Hopper128", 227, None),
    ((128, 128, 4, 16), {}, None, None, None),
    ((129, 128, 3, 16), {}, None, None, None),
    ((128, 128, 3, 16), {"activation": activations.sine}, None, None, None),
    ((16, 16, 3, 3), {"format": FLOAT32}, None, None, None),
    ((16, 16, 3, 3), {"format": E4M3}, None, None, None),
]


@pytest.mark.parametrize("arch", ARCHS)
@pytest.mark.parametrize("shape, options, on_hopper, hopper_kb, other_kb", CHOICES)
def test_choice(shape, options, on_hopper, hopper_kb, other_kb, arch):
    for kb in SHARED:
        made = choose_schedule(spec(*shape, **options), arch, kb << 10)
        if arch == 90 and on_hopper and kb >= hopper_kb:
            expected = on_hopper
        else:
            expected = "Mma" if arch >= 80 and other_kb and kb >= other_kb else None
        assert (type(made).__name__ if made else None) == (f"{expected}Schedule" if expected else None)
        assert made is None or 4 * made.words + SPARE_BYTES <= kb << 10


def test_mma_takes_small_networks():
    """Every width up to these depths, and none whose vectors or sums do not fit."""
    deepest = {32: 8, 48: 7, 64: 5, 96: 2, 128: 1}
    for width, depth in deepest.items():
        for d in range(9):
            assert (mma.make_schedule(spec(width, width, d, 16)) is not None) == (d <= depth), (width, d)


@pytest.mark.parametrize("kb", SHARED)
def test_mma_memory(kb):
    """A warp's area: its inputs h, results, gradients dz and dx, by the step at which each is written and last read."""
    for one, made in schedules(lambda one: mma.make_schedule(one, 80, kb << 10), MMA):
        assert made.words * 4 + SPARE_BYTES <= kb << 10
        assert made.sums <= dict(mma.CHOICES)[made.warps]
        layers, count = made.layers, len(made.layers)
        wide = [16 * round_up(layer.layout.n_pad, 16) for layer in layers]  # words of 32 samples' 16-bit vectors
        regions = [(layer.h, 16 * layer.layout.k_pad, l, 2 * count + 1 - l) for l, layer in enumerate(layers)]
        regions.append((made.output, 32 * layers[-1].layout.n_pad, count, count + 1))
        regions += [(layer.dz, wide[l], 2 * count - l, 2 * count + 1 - l) for l, layer in enumerate(layers)]
        regions.append((made.dx, 16 * layers[0].layout.k_pad, 2 * count + 1, 2 * count + 2))
        expect_apart(regions)
        assert all(start % 4 == 0 and 0 <= start and start + size <= made.area for start, size, *_ in regions)
        weights = [(layer.weights, layer.layout.bias - layer.layout.weights, 0, 0) for layer in layers]
        expect_apart(weights)
        assert max(start + size for start, size, *_ in weights) <= made.weights
        assert made.words >= made.weights + made.warps * made.area
        copies = [(layer.copies, layer.end - layer.copies, 0, 0) for layer in layers]
        expect_apart([*copies, (made.copies, made.warps, 0, 0)])
        assert made.words >= made.copies + made.warps
        if kb == SHARED[-1]:
            expect_whole(made, one)


def test_mma_work():
    """Each unit of each layer's gradient is one warp's for each split of the samples, in registers of its own."""
    for _, made in schedules(mma.make_schedule, MMA):
        registers = []
        for index, layer in enumerate(made.layers):
            units = []
            for warp in range(layer.tasks * layer.splits):
                task, split = warp % layer.tasks, warp // layer.tasks
                row, column = task // layer.column_groups * layer.rows, task % layer.column_groups * layer.columns
                units += [(row + i, column + c, split) for i in range(layer.rows) for c in range(layer.columns)]
            assert layer.tasks * layer.splits <= made.warps and made.warps % layer.splits == 0
            assert sorted(units) == [
                (n, k, split)
                for n in range(layer.n_blocks)
                for k in range(layer.k_blocks)
                for split in range(layer.splits)
            ]
            registers.append((layer.sums, 8 * layer.rows * layer.columns, 0, 0))
            if index % 8 == 0:  # which eight layers share, each in a column of one product
                registers.append((made.bias_sums(index), 4 * max(each.rows for each in made.layers), 0, 0))
        expect_apart(registers)
        assert all(0 <= start and start + size <= made.sums for start, size, *_ in registers)


def test_hopper64_memory():
    """A warpgroup's area, as that of a warp in `test_mma_memory`; products of the first two layers come last."""
    assert len(schedules(hopper64.make_schedule, HOPPER64)) == len(HOPPER64)
    for one, made in schedules(hopper64.make_schedule, HOPPER64):
        count, slot, last_size = len(made.layers), hopper64.SLOT, hopper64.SAMPLES * hopper64.LAST_ROW
        end = 2 * count + 1
        gone = [end if l < 2 else end - l for l in range(count)]
        regions = [(l * slot, slot, l, gone[l]) for l in range(count)]
        regions.append((made.spare, slot, count, count))  # results
        sizes = [slot] * (count - 1) + [last_size]
        regions += [(made.dz(l), sizes[l], 2 * count - l, gone[l]) for l in range(count)]
        expect_apart(regions)
        assert all(start % 256 == 0 and start + size <= made.area for start, size, *_ in regions)
        expect_block_memory(made)
        expect_registers([(layer.sums, layer.bias_sums + (1 if layer.last else 4)) for layer in made.layers], made.sums)
        assert made.sums <= hopper64.MAX_SUMS
        expect_whole(made, one)


def expect_block_memory(made):
    """Weights, biases and areas of both warpgroups, in bytes."""
    panels = [-(-layer.layout.k_pad // 64) for layer in made.layers]
    heights = [round_up(layer.layout.n_pad, 16) * hopper64.ROW for layer in made.layers]
    regions = [(l.weights, p * height, 0, 0) for l, p, height in zip(made.layers, panels, heights, strict=True)]
    regions.append((made.biases, 4 * made.layers[0].layout.n_pad * len(made.layers), 0, 0))
    regions += [(made.areas + group * made.area, made.area, 0, 0) for group in range(2)]
    regions.append((made.ones, 16 * hopper64.ROW, 0, 0))
    expect_apart(regions)
    assert max(start + size for start, size, *_ in regions) + 1024 <= 4 * made.words <= (227 << 10) - SPARE_BYTES
    assert made.areas % 1024 == 0


def expect_registers(ranges, sums):
    """(begin, end) one after the other, no register left out or used twice."""
    assert [begin for begin, _ in ranges] == [0, *[end for _, end in ranges[:-1]]] and ranges[-1][1] == sums


def test_hopper128_passes():
    """They compute every layer's gradient once. Slots of an area, at the time when the most of them are in use."""
    assert len(schedules(hopper128.make_schedule, HOPPER128)) == len(HOPPER128)
    for one, made in schedules(hopper128.make_schedule, HOPPER128):
        count, slot = len(made.layers), hopper128.SLOT
        passes = [made, made.lower] if made.lower else [made]
        assert sorted(index for one_pass in passes for index in one_pass.gradients) == list(range(count))
        assert made.reaches_input == (made.lower is None)
        for one_pass in passes:
            assert one_pass.sums <= 136 and one_pass.floats == made.floats
            expect_block_memory(one_pass)
            first = one_pass.gradients[0]
            starts = [one_pass.first_sum(index) for index in one_pass.gradients]
            ends = [start + one_pass.layers[first + i].sums for i, start in enumerate(starts)]
            expect_registers(list(zip(starts, ends, strict=True)), one_pass.sums)
            sizes = {index: slot for index in range(count)} | {count - 1: hopper64.LAST_ROW * hopper128.SAMPLES}
            regions = [(one_pass.h(index), slot, 0, 0) for index in one_pass.gradients]
            regions += [(one_pass.dz(index), sizes[index], 0, 0) for index in one_pass.gradients]
            expect_apart(regions)
            assert all(start + size <= one_pass.area for start, size, *_ in regions)
        if made.lower:
            assert made.lower.kept == made.kept == made.low + 1
            assert {made.lower.h(index) for index in range(made.low)} == {slot * (1 + i) for i in range(made.low)}
        expect_whole(made, one)

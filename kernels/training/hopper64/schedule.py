"""How the two warpgroups of a block share a fused training step on Hopper, for networks of 64 neurons a layer.

Each takes 128 samples through all layers by itself. What the weights' gradient dW = dz^T H needs, every layer's input H
and dz, the gradient to its pre-activations, lies in shared memory in slots: rows of 64 16-bit elements, one a sample.
dW stays in registers for as long as the launch lasts; a column of ones beside H gives the biases' gradient with it.
"""

from dataclasses import dataclass

from warp_neural.kernels.coopvec.cuda.warpgroups import ROW
from warp_neural.kernels.coopvec.fragment_layout import Layout, warpgroup_accumulators
from warp_neural.kernels.coopvec.layout import LayerLayout, network_layout
from warp_neural.kernels.nn.spec import BFLOAT16, FLOAT16, NetworkSpec, round_up
from warp_neural.kernels.training.schedule import HOPPER_BYTES, Schedule

WIDTH = 64  # neurons of every hidden layer
SAMPLES = 128  # of a warpgroup and round, one a thread
GROUPS = 2  # warpgroups of a block
SLOT = SAMPLES * ROW
LAST_ROW = 32  # bytes of a sample's dz of the last layer
MAX_OUT = 16
MAX_SUMS = 120  # registers for sums, of the 255 that a thread can have


def weight_sums(layer: LayerLayout, last: bool) -> Layout:
    """Of the weights' gradient in the block sums: dz^T H, or for the last layer H^T dz."""
    n, k = layer.n_pad, layer.k_pad
    return warpgroup_accumulators(k, n).transposed if last else warpgroup_accumulators(n, k)


@dataclass(frozen=True)
class Hopper64Layer:
    """weights: where they lie in shared memory, in bytes. sums: the first register of the weights' gradient. first: the
    first of its floats in a block's gradient."""

    layout: LayerLayout
    last: bool
    weights: int
    sums: int
    first: int

    @property
    def columns(self) -> int:
        """Of the product that is the gradient: dz^T (H, ones), or for the last layer H^T dz."""
        return self.layout.n_pad if self.last else self.layout.k_pad + 8

    @property
    def registers(self) -> int:
        """Of a thread, for the weights' gradient; those of the biases follow."""
        return (self.layout.n_pad if self.last else self.layout.k_pad) // 2

    @property
    def bias_sums(self) -> int:
        return self.sums + self.registers

    @property
    def weight_sums(self) -> Layout:
        return weight_sums(self.layout, self.last)

    @property
    def bias_first(self) -> int:
        return self.first + self.weight_sums.elements


class HopperSchedule(Schedule):
    """What schedules for warpgroups have in common, from `areas`, `area` and `floats`."""

    threads = GROUPS * 128
    arch_suffix = "a"  # `wgmma` only exists in code for exactly one architecture
    dx = 0  # in an area: the slot for the gradient to the network's input

    @property
    def ones(self) -> int:
        return self.areas + GROUPS * self.area

    @property
    def words(self) -> int:
        return (1024 + self.ones + 16 * ROW) // 4


@dataclass(frozen=True)
class Hopper64Schedule(HopperSchedule):
    """Offsets in bytes from the first multiple of 1024 in shared memory: all weights, biases as float32, each
    warpgroup's area, ones. sums: registers. floats: of a block's gradient."""

    layers: tuple[Hopper64Layer, ...]
    biases: int
    sums: int
    floats: int

    @property
    def areas(self) -> int:
        return round_up(self.biases + 4 * WIDTH * len(self.layers), 1024)

    @property
    def area(self) -> int:
        """A slot for each layer's input, the spare one, and dz of the last layer."""
        return self.last_dz + SAMPLES * LAST_ROW

    @property
    def spare(self) -> int:
        """In an area: the slot for the results of the network, then for dz of the second last layer."""
        return len(self.layers) * SLOT

    @property
    def last_dz(self) -> int:
        return self.spare + SLOT

    def dz(self, index: int) -> int:
        """In an area: where dz of layer `index` lies. Once it is known, the slot is not needed for anything else."""
        after = len(self.layers) - 1 - index
        return (self.last_dz, self.spare, (index + 2) * SLOT)[min(after, 2)]


def takes(spec: NetworkSpec, width: int, arch: int) -> bool:
    """Whether warpgroups train such a network, with `width` neurons in every hidden layer."""
    sizes = set(spec.sizes[1:-1]) == {width} and spec.sizes[0] <= width and spec.sizes[-1] <= MAX_OUT
    slope = bool(spec.activation.slope_at_result)
    return arch == 90 and sizes and spec.format in (FLOAT16, BFLOAT16) and slope


def make_schedule(spec: NetworkSpec, arch: int = 90, shared_bytes: int = HOPPER_BYTES) -> Hopper64Schedule | None:
    """See `Room`."""
    if not takes(spec, WIDTH, arch):
        return None
    weights, sums, first, layers = 0, 0, 0, []
    layouts, _ = network_layout(spec, True)
    for index, layout in enumerate(layouts):
        layer = Hopper64Layer(layout, index == len(layouts) - 1, weights, sums, first)
        weights += round_up(layout.n_pad, 16) * ROW
        sums = layer.bias_sums + (1 if layer.last else 4)
        first = layer.bias_first + layout.n_pad
        layers.append(layer)
    schedule = Hopper64Schedule(tuple(layers), weights, sums, first)
    return schedule if sums <= MAX_SUMS and schedule.fits(shared_bytes) else None

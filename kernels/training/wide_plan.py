"""How the two warpgroups of a block share a fused training step on Hopper, for networks of 128 neurons a layer.

Each takes 64 samples through all layers; the gradient of a layer's weights, dW = dz^T H, has the 128 samples of both as
its inner dimension, and each warpgroup keeps the rows of 64 neurons of it in registers. They hold one layer of 128 x
128 beside the vectors: a step takes several passes, from the last layers to the first, each a launch that computes what
it needs again. Slots are those of `warpgroup_plan`, in panels of 64 columns.
"""

from dataclasses import dataclass

from kernels.coopvec.layout import LayerLayout, network_layout
from kernels.coopvec.spec import NetworkSpec, round_up
from kernels.training.warpgroup_plan import GROUPS, LAST_ROW, ROW, HopperPlan, takes

WIDTH = 128
SAMPLES = 64  # of a warpgroup and round
PANEL = SAMPLES * ROW
SLOT = WIDTH // 64 * PANEL
MASKS = 128 * 8  # bytes: of a layer, which of a thread's 64 results are positive
PASS_LAYERS, PASS_SUMS = 2, 80  # that a pass takes at most: layers, registers for sums
MAX_DEPTH = 3  # hidden layers whose weights fit


@dataclass(frozen=True)
class WideLayer:
    """weights: in shared memory, panels of 64 columns, in bytes. first: of its floats in a block's gradient."""

    layout: LayerLayout
    last: bool
    weights: int
    first: int

    @property
    def columns(self) -> int:
        """Of the product that is the gradient: dz^T H, or for the last layer H^T dz."""
        return self.layout.n_pad if self.last else self.layout.k_pad

    @property
    def panel(self) -> int:
        return round_up(self.layout.n_pad, 16) * ROW

    @property
    def registers(self) -> int:
        """Of a thread, for its part of the weights' gradient; those of the biases follow."""
        return self.columns // 2

    @property
    def sums(self) -> int:
        return self.registers + (1 if self.last else 4)

    @property
    def bias_first(self) -> int:
        return self.first + GROUPS * self.registers * 128


@dataclass(frozen=True)
class WidePlan(HopperPlan):
    """The pass that computes the gradients of layers `low` to `high`. Offsets in bytes as in `WarpgroupPlan`."""

    lanes = 16
    layers: tuple[WideLayer, ...]
    low: int
    high: int
    biases: int
    floats: int

    @property
    def gradients(self) -> range:
        return range(self.low, self.high + 1)

    @property
    def sums(self) -> int:
        return sum(self.layers[index].sums for index in self.gradients)

    def first_sum(self, index: int) -> int:
        return sum(self.layers[i].sums for i in range(self.low, index))

    @property
    def areas(self) -> int:
        return round_up(self.biases + 4 * WIDTH * len(self.layers), 1024)

    def h(self, index: int) -> int:
        """In an area: the slot of the input of layer `index`."""
        return (index - self.low) * SLOT

    @property
    def spare(self) -> int:
        return (self.high - self.low + 1) * SLOT

    @property
    def last_dz(self) -> int:
        return self.spare + SLOT

    def dz(self, index: int) -> int:
        """In an area: where dz of layer `index` lies, with what was there no longer needed."""
        if self.layers[index].last:
            return self.last_dz
        above = min(self.high, len(self.layers) - 2)  # the first in the spare slot
        return self.spare if index == above else self.h(index + 1)

    @property
    def masks(self) -> int:
        return self.last_dz + round_up(SAMPLES * LAST_ROW, 1024)

    @property
    def area(self) -> int:
        return self.masks + (len(self.layers) - 1) * MASKS

    @property
    def reaches_input(self) -> bool:
        return self.low == 0


def make_wide_plans(spec: NetworkSpec) -> tuple[WidePlan, ...]:
    """The passes, in order; none for a network that is not trained this way."""
    if not takes(spec, WIDTH) or len(spec.sizes) - 2 > MAX_DEPTH:
        return ()
    weights, first, layers = 0, 0, []
    layouts, _ = network_layout(spec, True)
    for index, layout in enumerate(layouts):
        layer = WideLayer(layout, index == len(layouts) - 1, weights, first)
        weights += -(-layout.k_pad // 64) * layer.panel
        first = layer.bias_first + layout.n_pad
        layers.append(layer)
    passes, high = [], len(layers) - 1
    while high >= 0:
        low = high
        while low > 0 and high - low + 1 < PASS_LAYERS and sum(l.sums for l in layers[low - 1 : high + 1]) <= PASS_SUMS:
            low -= 1
        passes.append(WidePlan(tuple(layers), low, high, weights, first))
        high = low - 1
    return tuple(passes)

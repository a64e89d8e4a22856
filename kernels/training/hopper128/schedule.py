"""How the two warpgroups of a block share a fused training step on Hopper, for networks of 128 neurons a layer.

Each takes 64 samples through all layers; the gradient of a layer's weights, dW = dz^T H, has the 128 samples of both as
its inner dimension, and each warpgroup keeps the rows of 64 neurons of it in registers. They hold two such layers at
most: the upper pass goes through all layers and computes the gradients of the last two, the lower pass those of the
others. Between the passes each layer's input H and the last dz that was computed lie in memory, tile by tile as
they lie in shared memory. Slots are those of `hopper64.schedule`, in panels of 64 columns.
"""

from dataclasses import dataclass

from warp_neural.kernels.coopvec.fragment_layout import Layout
from warp_neural.kernels.coopvec.layout import LayerLayout, network_layout
from warp_neural.kernels.nn.spec import NetworkSpec, round_up
from warp_neural.kernels.training.hopper64.schedule import LAST_ROW, ROW, HopperSchedule, takes, weight_sums
from warp_neural.kernels.training.schedule import HOPPER_BYTES

WIDTH = 128
SAMPLES = 64  # of a warpgroup and round: a tile
PANEL = SAMPLES * ROW
SLOT = WIDTH // 64 * PANEL
MAX_DEPTH = 3  # hidden layers whose weights fit


@dataclass(frozen=True)
class Hopper128Layer:
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
    def panels(self) -> int:
        return -(-self.layout.k_pad // 64)

    @property
    def end(self) -> int:
        """Of the weights."""
        return self.weights + self.panels * self.panel

    @property
    def registers(self) -> int:
        """Of a thread, for its part of the weights' gradient; those of the biases follow."""
        return self.columns // 2

    @property
    def sums(self) -> int:
        return self.registers + (1 if self.last else 4)

    @property
    def weight_sums(self) -> Layout:
        return weight_sums(self.layout, self.last)

    @property
    def bias_first(self) -> int:
        return self.first + self.weight_sums.elements


@dataclass(frozen=True)
class Hopper128Pass(HopperSchedule):
    """layers: whose weights a block has, from the first on. floats: of a block's gradient, in both passes. Offsets in
    bytes as in `Hopper64Schedule`.

    Each kind of schedule has `low`, the first layer of the upper pass; `gradients`, a range: the layers whose gradients
    its pass computes; and in an area `h(index)` and `dz(index)`, where the input of a layer and its dz lie.
    """

    lanes = 16
    layers: tuple[Hopper128Layer, ...]
    floats: int

    @property
    def biases(self) -> int:
        return self.layers[-1].end

    @property
    def sums(self) -> int:
        return sum(self.layers[index].sums for index in self.gradients)

    def first_sum(self, index: int) -> int:
        return sum(self.layers[i].sums for i in range(self.gradients[0], index))

    @property
    def areas(self) -> int:
        return round_up(self.biases + 4 * WIDTH * len(self.layers), 1024)

    @property
    def kept(self) -> int:
        """Slots of a tile in memory: dz of layer `low` - 1, then the inputs of the layers from there to the first."""
        return self.low + 1 if self.low else 0

    def kept_units(self, blocks: int, batch: int) -> int:
        """For the samples of whole rounds."""
        round = blocks * self.round_samples
        return -(-batch // round) * round // SAMPLES * self.kept * SLOT // 16


class Hopper128LowerSchedule(Hopper128Pass):
    """An area has what was kept, and another slot for dz of layer 0 or the gradient to the input."""

    @property
    def low(self) -> int:
        return len(self.layers)

    @property
    def gradients(self) -> range:
        return range(self.low)

    def h(self, index: int) -> int:
        return (self.low - index) * SLOT

    def dz(self, index: int) -> int:
        return 0 if index == self.low - 1 else self.dx

    @property
    def dx(self) -> int:
        return self.kept * SLOT

    @property
    def area(self) -> int:
        return self.dx + SLOT


class Hopper128Schedule(Hopper128Pass):
    """An area has slots for the inputs of the last two layers, the spare one, and dz of the last."""

    spare = 2 * SLOT
    last_dz = 3 * SLOT
    area = last_dz + round_up(SAMPLES * LAST_ROW, 1024)

    @property
    def low(self) -> int:
        return len(self.layers) - 2

    @property
    def gradients(self) -> range:
        return range(self.low, len(self.layers))

    @property
    def lower(self) -> Hopper128LowerSchedule | None:
        return Hopper128LowerSchedule(self.layers[: self.low], self.floats) if self.low else None

    def h(self, index: int) -> int:
        return (index - self.low) * SLOT

    def dz(self, index: int) -> int:
        return self.last_dz if self.layers[index].last else self.spare

    @property
    def reaches_input(self) -> bool:
        return self.low == 0


def make_schedule(spec: NetworkSpec, arch: int = 90, shared_bytes: int = HOPPER_BYTES) -> Hopper128Schedule | None:
    """See `Room`."""
    depth = len(spec.sizes) - 2
    if not takes(spec, WIDTH, arch) or depth > MAX_DEPTH:
        return None
    weights, first, layers = 0, 0, []
    for index, layout in enumerate(network_layout(spec, True)[0]):
        layers.append(Hopper128Layer(layout, index == depth, weights, first))
        weights, first = layers[-1].end, layers[-1].bias_first + layout.n_pad
    schedule = Hopper128Schedule(tuple(layers), first)
    passes = [schedule, schedule.lower] if schedule.lower else [schedule]
    return schedule if all(one.fits(shared_bytes) for one in passes) else None

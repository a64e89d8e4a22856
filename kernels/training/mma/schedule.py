"""How a block of warps shares the work and the shared memory of a fused training step on CUDA.

Every warp takes 32 samples through all layers by itself. The gradient of a layer's weights, dW = dZ^T H, has the
samples of the whole block as its inner dimension: its 16 x 16 units are dealt to the warps ("tasks" of rows x columns
units), so that each warp holds only its tasks' sums in registers for as long as the launch lasts. A layer with fewer
tasks than warps splits the samples as well ("splits").
"""

from dataclasses import dataclass
from functools import cache

from warp_neural.kernels.coopvec.fragment_layout import Layout, accumulators
from warp_neural.kernels.coopvec.layout import LayerLayout, network_layout
from warp_neural.kernels.nn.spec import BFLOAT16, FLOAT16, NetworkSpec, round_up
from warp_neural.kernels.training.schedule import HOPPER_BYTES, Schedule

CHOICES = ((8, 124), (4, 208))  # warps of a block, and the float32 registers a lane may spend on weight gradients


@dataclass(frozen=True)
class MmaLayer:
    """One layer: `rows` x `columns` units a task, `splits` of the samples. Offsets in 32-bit words: `weights` in shared
    memory, `dz` and `h` (the layer's input) in a warp's area, `sums` in a lane's registers, `first` in the block's
    gradient, `copies` in shared memory where the splits' gradients meet.
    """

    layout: LayerLayout
    rows: int
    columns: int
    splits: int
    weights: int
    h: int
    dz: int
    sums: int
    first: int
    copies: int

    @property
    def k_blocks(self) -> int:
        return self.layout.k_pad // 16

    @property
    def n_blocks(self) -> int:
        return round_up(self.layout.n_pad, 16) // 16

    @property
    def column_groups(self) -> int:
        return self.k_blocks // self.columns

    @property
    def tasks(self) -> int:
        return self.n_blocks // self.rows * self.column_groups

    @property
    def weight_sums(self) -> Layout:
        """Of the weights' gradient in the block sums."""
        return accumulators(self.layout.n_pad, self.layout.k_pad)

    @property
    def weight_floats(self) -> int:
        return self.weight_sums.elements

    @property
    def bias_first(self) -> int:
        return self.first + self.weight_floats

    @property
    def bias_copies(self) -> int:
        return self.copies + self.splits * self.weight_floats

    @property
    def end(self) -> int:
        """Of the copies."""
        return self.bias_copies + self.splits * self.column_groups * self.n_blocks * 16


@dataclass(frozen=True)
class MmaSchedule(Schedule):
    """warps: of a block. weights: words of shared memory for all weights, after which each warp has `area` words, with
    results at `output` and the gradient to the network's input at `dx`. sums: registers a lane, those of the biases
    last. floats: of one block's gradient, in the order of the accumulators.
    """

    layers: tuple[MmaLayer, ...]
    warps: int
    weights: int
    area: int
    dx: int
    output: int
    sums: int
    floats: int

    @property
    def words(self) -> int:
        """Shared memory of a block; at the end it holds the copies of the gradient and, from `copies` on, losses."""
        return max(self.weights + self.warps * self.area, self.copies + self.warps)

    @property
    def copies(self) -> int:
        return self.layers[-1].end

    @property
    def threads(self) -> int:
        return 32 * self.warps

    def bias_sums(self, index: int) -> int:
        """Where layer `index` has the registers of its biases, which eight layers share."""
        rows = max(layer.rows for layer in self.layers)
        return self.sums - 4 * rows * (-(-len(self.layers) // 8) - index // 8)

    def constants(self, index: int) -> dict[str, int]:
        """Of native text: how the gradient of layer `index` is dealt to warps and registers."""
        layer = self.layers[index]
        return {
            "TASKS": layer.tasks,
            "SPLITS": layer.splits,
            "ROWS": layer.rows,
            "COLUMNS": layer.columns,
            "GROUPS": layer.column_groups,
            "N_BLOCKS": layer.n_blocks,
            "K_BLOCKS": layer.k_blocks,
            "SUMS": layer.sums,
            "BIAS_SUMS": self.bias_sums(index),
            "COLUMN": index % 8,  # of one product, in which the biases of a layer meet
        }

    @property
    def barrier(self) -> str:
        """Before a warp reads what others wrote; where every warp takes all units, each reads only its own."""
        return "__syncwarp();" if all(layer.splits == self.warps for layer in self.layers) else "__syncthreads();"


def split_work(n_blocks: int, k_blocks: int, warps: int, limit: int) -> tuple[int, int, int] | None:
    """(rows, columns, splits) of a task with at most `limit` units: the shortest time, then the fewest loads."""
    choices = []
    for rows in (r for r in range(1, n_blocks + 1) if n_blocks % r == 0):
        for columns in (c for c in range(1, k_blocks + 1) if k_blocks % c == 0):
            tasks = n_blocks // rows * (k_blocks // columns)
            if tasks <= warps and rows * columns <= limit:
                splits = 1 << (warps // tasks).bit_length() - 1
                choices.append((rows * columns / splits, (rows + columns) / splits, rows, columns, splits))
    return min(choices)[2:] if choices else None


@cache
def make_schedule(spec: NetworkSpec, arch: int = 90, shared_bytes: int = HOPPER_BYTES) -> MmaSchedule | None:
    """See `Room`. None for other formats than 16 bits, or sums or vectors that do not fit."""
    if spec.format not in (FLOAT16, BFLOAT16):
        return None
    for warps, most_sums in CHOICES:
        for limit in (16, 8, 4, 2, 1):
            schedule = schedule_with(spec, warps, limit)
            if schedule and schedule.fits(shared_bytes) and schedule.sums <= most_sums:
                return schedule
    return None


def schedule_with(spec: NetworkSpec, warps: int, limit: int) -> MmaSchedule | None:
    layouts, _ = network_layout(spec, True)
    count = len(layouts)
    slot = 16 * max(layout.k_pad for layout in layouts)  # words of 32 samples' vectors
    output = count * slot
    extra = max(slot, 32 * layouts[-1].n_pad)  # where results lie as float32
    # dz of a layer replaces the input of the layer after the next, which no warp reads any more by then
    dz = [(l + 2) * slot for l in range(count - 2)] + [output] * (count > 1) + [output + extra]
    weights, sums, first, layers = 0, 0, 0, []
    for l, layout in enumerate(layouts):
        n_blocks, k_blocks = round_up(layout.n_pad, 16) // 16, layout.k_pad // 16
        shared = split_work(n_blocks, k_blocks, warps, limit)
        if shared is None:
            return None
        layer = MmaLayer(layout, *shared, weights, l * slot, dz[l], sums, first, layers[-1].end if layers else 0)
        weights += layout.bias - layout.weights
        sums += layer.rows * layer.columns * 8
        first += layer.weight_floats + n_blocks * 16
        layers.append(layer)
    sums += 4 * max(layer.rows for layer in layers) * -(-count // 8)
    area = output + extra + 16 * round_up(layouts[-1].n_pad, 16)
    return MmaSchedule(tuple(layers), warps, weights, area, slot if count > 1 else output, output, sums, first)

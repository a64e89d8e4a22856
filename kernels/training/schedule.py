"""How a block of warps shares a fused training step on CUDA: what the kernel asks of a schedule and of its texts.

A `Room` is one way of multiplying. It has a `Schedule`, which is pure data, and `Texts` that follow it; its `room.py`
ties them. `rooms.py` lists the rooms and chooses.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from warp_neural.kernels.coopvec.fragment_layout import Layout
from warp_neural.kernels.coopvec.layout import LayerLayout

HOPPER_BYTES = 227 * 1024  # of a block's shared memory, at most
SPARE_BYTES = 15 * 1024  # of it, for what samples need


class ScheduledLayer(Protocol):
    """first, bias_first: where its weights, in the order of `weight_sums`, and its biases begin in a block's sums."""

    layout: LayerLayout
    weight_sums: Layout
    first: int
    bias_first: int


class Schedule(Protocol):
    """threads: of a block, whose first `lanes` of each warp have a sample in a round. words: of shared memory, 32 bits
    each. sums: float32 registers of a thread for gradients, which it keeps for as long as the launch lasts. floats: of
    a block's gradient.

    lower: the schedule of a second pass, for the first layers where registers do not hold all gradients; it has their
    layers, and `floats` and `block_sums` of both. reaches_input: whether the first pass has the input's gradient.
    arch_suffix: of the architecture that the kernels are compiled for.
    """

    threads: int
    lanes: int = 32
    words: int
    layers: tuple[ScheduledLayer, ...]
    sums: int
    floats: int
    lower: "Schedule | None" = None
    reaches_input: bool = True
    arch_suffix: str = ""

    @property
    def round_samples(self) -> int:
        """Of a block in a round."""
        return self.threads // 32 * self.lanes

    @property
    def block_sums(self) -> int:
        """Floats that a block leaves: its gradient and, at `floats`, its loss."""
        return self.floats + 4

    def kept_units(self, blocks: int, batch: int) -> int:
        """Memory between the passes, in 16 bytes."""
        return 0

    def fits(self, shared_bytes: int) -> bool:
        """A block's shared memory."""
        return self.words * 4 + SPARE_BYTES <= shared_bytes


class Texts(NamedTuple):
    """CUDA text of native functions, or these, all for all threads. Their arguments are in `functions.make_functions`.

    begin: copies weights to shared memory. forward: keeps there what the way back needs. upper_layers: the way back but
    for the first layer's gradients (or those of the first two), which begin_first_layer starts and first_layer awaits:
    between them the next sample can be read. finish: leaves the block's sums.
    """

    begin: Any
    forward: Any
    upper_layers: Any
    begin_first_layer: Any
    first_layer: Any
    input_gradient: Any
    finish: Any


class LowerTexts(NamedTuple):
    """The same of a lower pass. fetch: begins to read what the first pass kept. layers: all gradients."""

    begin: Any
    fetch: Any
    layers: Any
    input_gradient: Any
    finish: Any


class Room(NamedTuple):
    """make_schedule: `(spec, arch, shared_bytes)` -> one of type `schedule` for such a device, or None where this way
    does not apply. make_texts: `(spec, schedule, x_type, input_gradient) -> Texts`; x_type: of the elements of the
    network's inputs and their gradients, which are asked for or not. make_lower_texts: the same of `schedule.lower`.
    """

    schedule: type[Schedule]
    make_schedule: Callable[[Any, int, int], Schedule | None]
    make_texts: Callable[[Any, Any, type, bool], Texts]
    make_lower_texts: Callable[[Any, Any, type, bool], LowerTexts] | None = None

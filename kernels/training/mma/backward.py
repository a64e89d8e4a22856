"""CUDA text of a fused training step's backward pass: gradients to the layers' inputs and to their weights.

Names as in `kernels.training.mma.forward`. Layer by layer from the last: `dz`, the gradient to its pre-activations,
lies in the areas of all warps; each warp multiplies its own by the weights for the layer before, and everyone's
by the layer's inputs for its own tasks of the weights' gradient (see `schedule`), which it keeps in registers.
"""

from pathlib import Path

from warp_neural.kernels.native import paste
from warp_neural.kernels.nn.activations import linear, relu
from warp_neural.kernels.nn.spec import NetworkSpec
from warp_neural.kernels.training.mma.forward import enter
from warp_neural.kernels.training.mma.schedule import MmaSchedule
from warp_neural.kernels.training.text import take_dx

NATIVE = Path(__file__).parent / "native"


def start(spec: NetworkSpec, schedule: MmaSchedule) -> str:
    """The last layer's dz of each thread's own sample to the area."""
    final, n_out = schedule.layers[-1], spec.sizes[-1]
    text = ""
    for u in range(2 * final.n_blocks):
        pairs = [(8 * u + 2 * t, 8 * u + 2 * t + 1) for t in range(4)]
        values = [[f"dy.c[{n}] * d_last(z.c[{n}])" if n < n_out else "0.0f" for n in pair] for pair in pairs]
        words = ", ".join(f"pack({low}, {high})" for low, high in values)
        text += f"save_unit(own_unit(area + {4 * final.dz}, {final.n_blocks}, {u}), {words});\n"
    return text


def upper_layers_text(spec: NetworkSpec, schedule: MmaSchedule) -> str:
    """`(memory, sums, z, dy) -> sums`: all layers but the first; dy is of the activated results. All threads."""
    layers = "".join(backward_layer(spec, schedule, index, True) for index in reversed(range(1, len(schedule.layers))))
    return f"{enter(spec, schedule)}auto sum = sums;\n{start(spec, schedule)}{layers}return sum;\n"


def first_layer_text(spec: NetworkSpec, schedule: MmaSchedule, input_gradient: bool) -> str:
    """`(memory, sums) -> sums`: the first layer; `input_gradient` leaves dx in the area. All threads."""
    layer = backward_layer(spec, schedule, 0, input_gradient)
    return f"{enter(spec, schedule)}auto sum = sums;\n{layer}{schedule.barrier}\nreturn sum;\n"


def backward_layer(spec: NetworkSpec, schedule: MmaSchedule, index: int, go_on: bool) -> str:
    """Layer `index`, whose dz, of the whole block, lies in the areas after the barrier."""
    text = input_products(spec, schedule, index) if go_on else ""
    return f"{schedule.barrier}\n{{ {text}}}\n{{ {weight_products(spec, schedule, index)}}}\n"


def input_products(spec: NetworkSpec, schedule: MmaSchedule, index: int) -> str:
    """dh = dz W, times the slope of the layer before: that layer's dz, saved."""
    layer = schedule.layers[index]
    sloped = index > 0 and spec.activation is not linear
    word = "pack(a, b)"
    if sloped and spec.activation is relu:  # a positive half is not zero: then the sum's sign bit is set
        word += " & spread_signs(kept + 0x7fff7fffu)"
    elif sloped:
        word = "pack(a * d_hidden(low(kept)), b * d_hidden(high(kept)))"
    back_word = f"auto back_word = [&](real a, real b, unsigned kept) {{ return {word}; }};\n"
    return back_word + paste(
        NATIVE / "input_products.cuh",
        N_BLOCKS=layer.n_blocks,
        K_BLOCKS=layer.k_blocks,
        PAIRS=layer.layout.k_pairs(spec.format),
        TILES=layer.layout.n_pad // 8,
        WEIGHTS=4 * layer.weights,
        DZ=4 * layer.dz,
        H=4 * layer.h,
        TARGET=4 * (schedule.layers[index - 1].dz if index else schedule.dx),
        SLOPED=int(sloped),
    )


def weight_products(spec: NetworkSpec, schedule: MmaSchedule, index: int) -> str:
    """dZ^T H of this warp's units."""
    layer = schedule.layers[index]
    return paste(
        NATIVE / "weight_products.cuh",
        **schedule.constants(index),
        WARPS=schedule.warps,
        DZ=4 * layer.dz,
        H=4 * layer.h,
        AREA=4 * schedule.area,
        PRE_ACTIVATIONS=int(index > 0 and not spec.activation.slope_at_result),
    )


def input_gradient_text(spec: NetworkSpec, schedule: MmaSchedule, dtype: type) -> str:
    """`(memory) -> dx`, a vector of `dtype`, of this thread's sample, as `first_layer` left it."""
    blocks = schedule.layers[0].k_blocks
    take = take_dx(spec.sizes[0], dtype, lambda u: f"own_unit(area + {4 * schedule.dx}, {blocks}, {u})")
    return f"{enter(spec, schedule)}{take}return dx;\n"

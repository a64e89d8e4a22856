"""CUDA text that the rooms of fused training share. Names as in `kernels.coopvec.cuda.fragments`."""

from collections.abc import Callable
from pathlib import Path

from warp_neural.kernels.native import paste
from warp_neural.kernels.nn.spec import C_TYPES, FLOAT16, NetworkSpec
from warp_neural.kernels.training.schedule import Schedule

NATIVE = Path(__file__).parent / "native"


def ones_of(spec: NetworkSpec) -> str:
    """Two, in one register."""
    return "0x3c003c00u" if spec.format is FLOAT16 else "0x3f803f80u"


def finish_names(schedule: Schedule, losses_and_sums: str) -> str:
    """Names for the end of a launch; a flag unless all of `losses_and_sums`, a C++ expression, is finite."""
    check = f"if (!({losses_and_sums} == 0.0f)) flags.data[parity] = 1;\n"
    return paste(NATIVE / "finish.cuh", BLOCK_SUMS=schedule.block_sums) + check


def slopes(spec: NetworkSpec) -> str:
    """Lambdas: the derivatives of the activations, of hidden layers at what is kept."""
    return "".join(
        f"auto d_{name} = [](real z) -> real {{ return {derivative}; }};\n"
        for name, derivative in (("hidden", spec.activation.kept_slope), ("last", spec.output_activation.derivative))
    )


def take_dx(n_in: int, dtype: type, address: Callable[[int], str]) -> str:
    """`dx`, from 16-byte units of 8 elements each at `address(unit)`."""
    text = f"wp::vec_t<{n_in}, {C_TYPES[dtype]}> dx;\n"
    for u in range(-(-n_in // 8)):
        text += f"{{ unsigned v[4]; load_unit({address(u)}, v);\n"
        for k in range(8 * u, min(8 * u + 8, n_in)):
            text += f"dx.c[{k}] = {C_TYPES[dtype]}({('low', 'high')[k % 2]}(v[{k % 8 // 2}]));\n"
        text += "}\n"
    return text

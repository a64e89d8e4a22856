"""CUDA text of the primitives: lanes, staging in shared memory, conversion to registers of each format, `mma.sync`."""

import warp as wp

from warp_neural.kernels.coopvec import NATIVE
from warp_neural.kernels.coopvec.layout import network_layout
from warp_neural.kernels.coopvec.pool import OWN_POOL
from warp_neural.kernels.native import paste
from warp_neural.kernels.nn.spec import BFLOAT16, E4M3, E5M2, FLOAT16, INT8, TF32, Format, NetworkSpec

MATRICES = paste(NATIVE / "matrices.cuh")
MMA_TYPES = {
    FLOAT16: ("m16n8k16", "f16"),
    BFLOAT16: ("m16n8k16", "bf16"),
    TF32: ("m16n8k8", "tf32"),
    E4M3: ("m16n8k32", "e4m3"),
    E5M2: ("m16n8k32", "e5m2"),
    INT8: ("m16n8k32", "s8"),
}


def accumulator(spec: NetworkSpec) -> tuple[str, int]:
    """C++ type and count of one tile's accumulator registers."""
    if spec.format is INT8:
        return "integer", 4
    return ("unsigned", 2) if spec.accumulation == "float16" else ("real", 4)


def staging(spec: NetworkSpec) -> str:
    """The shared memory that vectors pass through; needs the lanes of `prelude`."""
    return OWN_POOL + paste(NATIVE / "staging.cuh", ROW_UNITS=row_units(spec))


def row_units(spec: NetworkSpec) -> int:
    """16-byte units of the longer of input and output row, rounded up to a power of two."""
    layers, _ = network_layout(spec, True)
    output_bits = 16 if packs_halves(spec) else 32
    units = max(layers[0].k_pad * spec.format.bits, layers[-1].n_pad * output_bits) // 128
    return 1 << (units - 1).bit_length()


def mma(name: str, format: Format, accumulator_type: str) -> str:
    """A lambda `name(d, c, a, b0, b1)`: d = c + a b on one 16 x 8 tile."""
    shape, element = MMA_TYPES[format]
    result, count, constraint = {"unsigned": ("f16", 2, "r"), "real": ("f32", 4, "f"), "integer": ("s32", 4, "r")}[
        accumulator_type
    ]

    def operands(first, number):
        return "{" + ",".join(f"%{i}" for i in range(first, first + number)) + "}"

    outputs = ", ".join(f'"={constraint}"(d[{i}])' for i in range(count))
    inputs = ", ".join([f'"r"(a[{i}])' for i in range(4)] + ['"r"(b0)', '"r"(b1)'])
    inputs += "".join(f', "{constraint}"(c[{i}])' for i in range(count))
    types = f"{accumulator_type} (&d)[{count}], const {accumulator_type} (&c)[{count}]"
    return f"""auto {name} = []({types}, const unsigned (&a)[4], unsigned b0, unsigned b1) {{
asm("mma.sync.aligned.{shape}.row.col.{result}.{element}.{element}.{result} "
    "{operands(0, count)},{operands(count, 4)},{operands(count + 4, 2)},{operands(count + 6, count)};"
    : {outputs} : {inputs}); }};
"""


def prelude(spec: NetworkSpec) -> str:
    """The lambdas that the rest of the text is made of."""
    files = "lanes", "halves", f"pack_{spec.format.name}"
    text = "".join(paste(NATIVE / f"{file}.cuh") for file in files)
    text += mma("multiply", spec.format, accumulator(spec)[0])
    for name, activation in (("hidden", spec.activation), ("last", spec.output_activation)):
        text += f"auto {name} = [](real z) -> real {{ return {activation.value}; }};\n"
    return text


def packs_halves(spec: NetworkSpec) -> bool:
    """Whether results leave as pairs of float16."""
    return spec.accumulation == "float16" or spec.dtype is wp.float16

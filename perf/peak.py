"""What the machine multiplies at most: `mma.sync` alone, fused multiply-adds on a CPU, and a large PyTorch product."""

from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec

import numpy as np
import warp as wp

from perf.measure import WARM_UP, Bench, check

STEPS = 4097  # odd: the second operand, which changes its sign every step, ends as it is


@dataclass(frozen=True)
class Product:
    """One `mma.sync` instruction. one: the bits of 1; negative: of -1; flip: what changes the sign (0: none does)."""

    depth: int
    types: str
    one: int
    negative: int
    flip: int
    accumulator: str

    @property
    def per_word(self) -> int:
        return self.depth // 8


# by (precision, accumulation) of a network
PRODUCTS = {
    ("float16", "float16"): Product(16, "f16.f16.f16.f16", 0x3C00, 0xBC00, 0x80008000, "half"),
    ("float16", "float32"): Product(16, "f32.f16.f16.f32", 0x3C00, 0xBC00, 0x80008000, "float"),
    ("bfloat16", "float32"): Product(16, "f32.bf16.bf16.f32", 0x3F80, 0xBF80, 0x80008000, "float"),
    ("e4m3", "float16"): Product(32, "f16.e4m3.e4m3.f16", 0x38, 0xB8, 0x80808080, "half"),
    ("int8", "float32"): Product(32, "s32.s8.s8.s32", 0x01, 0xFF, 0, "int"),
}


def multiply_text(product: Product) -> str:
    """Two tiles of 16 rows times four of 8 columns, all in flight, on what a warp keeps in registers."""
    registers = 2 if product.accumulator == "half" else 4
    kind, constraint = ("float", "+f") if product.accumulator == "float" else ("unsigned", "+r")
    results = ",".join(f"%{i}" for i in range(registers))
    a, b = (",".join(f"%{registers + first + i}" for i in range(n)) for first, n in ((0, 4), (4, 2)))
    outputs = ",".join(f'"{constraint}"(c[m][j][{i}])' for i in range(registers))
    inputs = ",".join([*(f'"r"(a[m][{i}])' for i in range(4)), *(f'"r"(b[j][{i}])' for i in range(2))])
    instruction = f"mma.sync.aligned.m16n8k{product.depth}.row.col.{product.types}"
    add = {
        "half": 'float lo, hi; asm("{.reg .f16 l,h; mov.b32 {l,h},%2; cvt.f32.f16 %0,l; cvt.f32.f16 %1,h;}" '
        ': "=f"(lo), "=f"(hi) : "r"(c[m][j][r])); total += lo + hi;',
        "float": "total += c[m][j][r];",
        "int": "total += static_cast<real>(static_cast<signed>(c[m][j][r]));",
    }[product.accumulator]
    return f"""
const unsigned lane = threadIdx.x & 31u;
unsigned a[2][4], b[4][2];
{kind} c[2][4][{registers}] = {{}};
for (int m = 0; m < 2; ++m) for (int r = 0; r < 4; ++r) a[m][r] = source.data[(m * 4 + r) * 32 + lane];
for (int j = 0; j < 4; ++j) for (int r = 0; r < 2; ++r)
    b[j][r] = source.data[256 + (j * 2 + r) * 32 + lane] ^ {product.flip:#x}u;
#pragma unroll 4
for (int step = 0; step < {STEPS}; ++step) {{
#pragma unroll
    for (int j = 0; j < 4; ++j) {{
        b[j][0] ^= {product.flip:#x}u; b[j][1] ^= {product.flip:#x}u;
#pragma unroll
        for (int m = 0; m < 2; ++m)
            asm volatile("{instruction} {{{results}}},{{{a}}},{{{b}}},{{{results}}};" : {outputs} : {inputs});
    }}
}}
for (int m = 0; m < 2; ++m) for (int j = 0; j < 4; ++j) for (int r = 0; r < {registers}; ++r) {{ {add} }}
"""


VECTORS = range(8)  # of 16 floats, which stay in registers
CPU_TEXT = f"""
typedef real vec16 __attribute__((vector_size(64)));
const vec16 sign = static_cast<real>(source.data[0]) - vec16{{}}, one = -sign;
{"".join(f"vec16 x{v} = {v} - vec16{{}};" for v in VECTORS)}
for (int step = 0; step < {STEPS}; ++step) {{
{"".join(f"x{v} = __builtin_elementwise_fma(x{v}, sign, one);" for v in VECTORS)}
}}
for (int e = 0; e < 16; ++e) total += {" + ".join(f"x{v}[e]" for v in VECTORS)};
"""


@cache
def make_peak_kernel(product: Product | None):
    """Every thread does the same; `None`: for the CPU."""
    text = multiply_text(product) if product else "return 0.0f;"

    @wp.func_native(
        f"using real = wp::float32;\nreal total = 0;\n#if defined(__CUDA_ARCH__)\n{text}\n#else\n{CPU_TEXT}\n#endif\n"
        "return total;\n"
    )
    def multiply(source: wp.array[wp.uint32]) -> wp.float32: ...

    @wp.kernel(module="unique", enable_backward=False)
    def peak_kernel(source: wp.array[wp.uint32], y: wp.array[float]):
        y[wp.tid()] = multiply(source)

    return peak_kernel


def operands(product: Product, seed: int) -> tuple[np.ndarray, float]:
    """Random operands of ones and minus ones as registers [512], and the sum of all their products."""
    per_word, rng = product.per_word, np.random.default_rng(seed)
    signs = rng.integers(0, 2, (16, 8, 4, per_word)) * 2 - 1  # register, g, t, element: lane = 4 g + t
    codes = np.where(signs > 0, product.one, product.negative).astype(np.uint64)
    words = (codes << (np.arange(per_word, dtype=np.uint64) * np.uint64(32 // per_word))).sum(-1).astype(np.uint32)
    # the products run along (half, t, element); A's registers are (tile, half, rows + 8), B's (tile, half)
    a, b = signs[:8].reshape(2, 2, 2, 8, 4, per_word), signs[8:].reshape(4, 2, 8, 4, per_word)
    total = (a.sum((0, 2, 3)) * b.sum((0, 2))).sum()
    return words.ravel(), float(total if product.flip else total * STEPS)


def measure_mma(bench: Bench, kinds: list[tuple[str, str]]) -> dict[tuple[str, str], float]:
    """TFLOP/s of each kind's instruction, by (precision, accumulation)."""
    device, peaks = bench.device, {}
    warps = device.sm_count * 32
    for kind in kinds:
        product = PRODUCTS.get(kind)
        if product is None:
            continue
        words, expected = operands(product, bench.config.seed)
        source, y = wp.array(words, dtype=wp.uint32, device=device), wp.zeros(32 * warps, dtype=float, device=device)
        kernel = make_peak_kernel(product)
        launch = lambda: wp.launch(kernel, y.size, [source, y], device=device, block_dim=256)  # noqa: B023, E731
        launch()
        totals = y.numpy().reshape(warps, 32).sum(1)
        check(f"mma.sync {kind}", totals, np.full(warps, expected), 1e-6)
        flops = 2 * 16 * 8 * product.depth * 8 * STEPS * warps
        peaks[kind] = bench.speed(f"peak: mma.sync, {kind[0]}, {kind[1]} sums", "alone", launch, flops)
    return peaks


def measure_cpu(bench: Bench) -> float:
    """GFLOP/s of one core, float32."""
    device = wp.get_device("cpu")
    source, y = wp.array([1], dtype=wp.uint32, device=device), wp.zeros(256, dtype=float, device=device)
    # sign = 1 and one = -1: each accumulator falls by one a step, exactly
    launch = lambda: wp.launch(make_peak_kernel(None), y.size, [source, y], device=device)  # noqa: E731
    launch()
    expected = 16.0 * sum(v - STEPS for v in VECTORS)
    check("multiply-adds", y.numpy(), np.full(y.size, expected), 1e-6)
    return bench.speed("peak: multiply-adds, float32", "alone", launch, 2 * 16 * len(VECTORS) * STEPS * y.size)


def measure_torch(bench: Bench) -> None:
    """A square product, float16 of 8,192 on CUDA, float32 of 1,024 on one core."""
    if not find_spec("torch"):
        return
    import torch

    cuda = bench.device.is_cuda
    if cuda and not torch.cuda.is_available():
        return
    torch.set_num_threads(1)
    n, dtype = (8192, torch.float16) if cuda else (1024, torch.float32)
    a, b = (torch.rand(n, n, device="cuda" if cuda else "cpu", dtype=dtype) - 0.5 for _ in range(2))
    check("torch.matmul", (a @ b)[:8].float().cpu().numpy(), (a[:8].double() @ b.double()).cpu().numpy(), 5e-3)
    label = f"peak: torch.matmul, {str(dtype).split('.')[1]}, {n}"
    if not cuda:
        bench.speed(label, "alone", lambda: torch.matmul(a, b), 2 * n**3)
        return
    values = []
    for _ in range(WARM_UP + bench.config.rounds):
        begin, end = (torch.cuda.Event(enable_timing=True) for _ in range(2))
        begin.record()
        torch.matmul(a, b)
        end.record()
        torch.cuda.synchronize()
        values.append(begin.elapsed_time(end))
    bench.speed_of(label, "alone", np.array(values[WARM_UP:]), 2 * n**3)

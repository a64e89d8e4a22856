"""The goals of the project for speed and, where a sample measures it, quality: what `perf.report` judges."""

from perf import recorded
from perf.goal import Goal
from perf.networks import SHAPES, shape_name
from perf.texture_reading import GRIDS
from perf.texture_storage import ENGINE, RTXNTC

MIPMAPS, VECTORS, TRAINING, TEXTURES = "Mip maps", "Cooperative vectors", "Training", "Neural textures"
TERA = "TFLOP/s"

REGISTERS = (
    "Load/store unit and tensor pipe (at 3x64 busy in 70% of the cycles, by another counter than the profile's) are"
    " about equally busy; registers let few warps overlap them. Tried: weights made in registers (+3%), kept in L1"
    " (+1%), two rows a thread (-4 to -11%), fewer registers (spills)."
)
F32 = (
    "Packing float32 sums to float16; at width 64, 161 registers a thread let 12 warps in. Tried: at most 128"
    " registers, which the profile has (-1 to -42%); the bias added with ReLU (-5 to -7%)."
)
FP8 = "`mma.sync` of FP8 becomes conversions and HMMA on sm_90; Hopper's FP8 units need wgmma."
INT8 = "Instructions between the products. Tried: bias and scale in one multiply-add, 238 a 64x64 layer instead of 370."
MAPS = "This shader's maps hold little more: learning displayed error alone ends at 0.735 and 0.778 on two materials."
STONES = (
    "This set is the hardest of the three for every codec: plain BC1 has 0.043 at 12 bits, and RTXNTC its lowest PSNR."
)
ONE_BY_ONE = (
    "One input a network: the latency of the weights of 32 networks a warp. Tried: prefetching them (2.0 to 5.3)."
)
GRID = (
    "13 of 16 levels add 21 million floats to memory, which no counter shows at more than a third of its peak: most"
    " likely L2's rate of additions. The update of 11 million parameters is held back by DRAM. Tried: the update with"
    " all loads at once (-1%) or fewer threads (-9 to -25%); coarse tables summed in shared memory beside the fine ones"
    " (in use, 6% of a step). Not tried: float16 gradients, which would halve the bytes that are added."
)
TWO_PATHS = "NVRTC compiles two paths: for whole warps, and for warps with missing lanes or several networks."
FIRST_CALL = ("compile", "inference, 3x64", "cold")

INFERENCE = {
    ("float16, float16 sums", REGISTERS): (360, 420, 500, 540),
    ("float16, float32 sums", F32): (300, 340, 440, 480),
}


def mipmap_goals() -> list[Goal]:
    def whole(text: str, row: str, column: str, limit: float, unit: str = "") -> Goal:
        return Goal(MIPMAPS, text, "samples", row, column, limit, most=True, cuda=False, unit=unit)

    better = "mipmap: displayed error / better"
    iteration = ("An iteration, 2048 to 512, slangpy 0.133", "mipmap", "iteration", "time", 0.10)
    return [
        Goal(MIPMAPS, *iteration, most=True, unit="ms"),
        whole("`samples.mipmap`, empty cache", "mipmap", "command", 60, "s"),
        whole("its memory", "mipmap", "largest memory so far", 1.5, "GB"),
        whole("its linear error against box filtering", "mipmap: linear error / box", "figure", 1 / 3),
        whole("... against Toksvig", "mipmap: linear error / Toksvig", "figure", 1),
        whole("... against SGD", "mipmap: linear error / SGD", "figure", 0.5),
        whole("its displayed error against the better classical", better, "figure", 0.9),
        Goal(MIPMAPS, "`samples.mipmap`, displayed error", "samples", better, "figure", 0.7, most=True, why=MAPS),
    ]


def kernel(shape: str, row: str) -> str:
    return f"network {shape}, {row}"


def inference_goals() -> list[Goal]:
    names = [shape_name(*shape) for shape in SHAPES]
    goals = [
        Goal(
            VECTORS, f"{row}, {name}", "inference", row, name, limit, why=why, unit="TFLOP/s", kernel=kernel(name, row)
        )
        for (row, why), limits in INFERENCE.items()
        for name, limit in zip(names, limits, strict=True)
    ]
    for text, row, why in (("FP8", "e4m3, float16 sums", FP8), ("INT8", "int8, float32 sums", INT8)):
        where = {"why": why, "unit": TERA, "kernel": kernel("3x64", row)}
        goals.append(Goal(VECTORS, f"{text}, 3x64", "inference", row, "3x64", 600, **where))
    one = f"{1 << 31:,}"
    for shape, limit in recorded.DRIVER.items():
        name = shape_name(*shape)
        where = {"unit": TERA, "why": REGISTERS, "kernel": kernel(name, "float16, float16 sums")}
        goals.append(
            Goal(VECTORS, f"{name}, 2^18 inputs, driver {limit}", "divergence", one, f"float16 {name}", limit, **where)
        )
    for shape, ms in recorded.TINY_CUDA_NN_INFERENCE.items():
        name, share = shape_name(*shape), 0.7 if shape[1] >= 64 else 1
        text = f"memory to memory, {name}, {'0.7 of ' if share < 1 else ''}tiny-cuda-nn {ms}"
        where = {"most": True, "unit": "ms", "kernel": f"memory {name}"}
        goals.append(Goal(VECTORS, text, "inference", "memory, float16", name, share * ms, **where))
    for name in names[:2]:
        text, floor = f"memory to memory, {name}, of the floor", ("memory, floor", name)
        where = {"most": True, "of": floor, "kernel": f"memory {name}"}
        goals.append(Goal(VECTORS, text, "inference", "memory, float16", name, 1.3, **where))
    for threads, limit in recorded.DRIVER_SHARED["3x64"].items():
        if threads < 1 << 31:
            text = f"distinct networks, {threads:,} inputs each, driver {limit}"
            where = {"unit": TERA, "why": ONE_BY_ONE}
            if threads > 1:
                where |= {"why": REGISTERS, "kernel": kernel("3x64", "float16, float16 sums")}
            goals.append(Goal(VECTORS, text, "divergence", f"{threads:,}", "float16 3x64", limit, **where))
    core = ("one core, 2x32, float32", "inference", "float32, float32 sums", "2x32")
    goals += [
        Goal(VECTORS, "first call, empty cache", *FIRST_CALL, 1, most=True, unit="s", why=TWO_PATHS),
        Goal(VECTORS, "first call, empty cache", *FIRST_CALL, 3, most=True, cuda=False, unit="s"),
        Goal(VECTORS, *core, 40, cuda=False, unit="GFLOP/s"),
    ]
    return goals


def step_goals() -> list[Goal]:
    """Times of training steps, against other libraries."""
    goals = []
    for name, times in recorded.TINY_CUDA_NN_STEPS.items():
        for batch, ms in times.items():
            text = f"a step, {name}, {batch:,} samples, half of tiny-cuda-nn's {ms}"
            where = {"most": True, "unit": "ms", "kernel": f"train {name}, gradient"}
            goals.append(Goal(TRAINING, text, "training", f"{name}, {batch:,}", "step", ms / 2, **where))
    for row, whose, ms in recorded.OTHER_STEPS:
        text = f"a step, {row} samples, {whose}: {ms}"
        goals.append(Goal(TRAINING, text, "training", row, "step", ms, most=True, unit="ms"))
    return goals


def training_goals() -> list[Goal]:
    goals, plain = step_goals(), "texture, per_thread"
    for cuda in (True, False):
        where = {"of": ("texture, unfused", "step"), "cuda": cuda}
        goals.append(
            Goal(
                TRAINING,
                "a neural texture's step, plain arithmetic over cooperative vectors",
                "training",
                plain,
                "step",
                3,
                **where,
            )
        )
        text, row = "PSNR after the same steps, float16 under float32", "float16 under float32"
        goals.append(Goal(TRAINING, text, "precision", row, "trained", 0.3, most=True, cuda=cuda, unit="dB"))
    for step in range(2, 6):
        row, before = (f"network: psnr step {k:02}" for k in (step, step - 1))
        text = f"`samples.network`, PSNR of step {step} over the one before"
        goals.append(Goal(TRAINING, text, "samples", row, "figure", 1, cuda=False, of=(before, "figure")))
    core = ("one core, a step of 16,384", "cpu", "Warp Neural", "training step")
    command = ("`samples.network`, empty cache", "samples", "network", "command")
    eager = ("PyTorch eager", "training step")
    return [
        *goals,
        Goal(TRAINING, *core, 1, most=True, cuda=False, of=eager),
        Goal(TRAINING, *command, 120, most=True, cuda=False, unit="s"),
    ]


def texture_goals() -> list[Goal]:
    step, eager = ("Warp Neural", "step"), ("PyTorch eager, float32", "step")
    least = {"row": "ahead: PSNR", "column": "least of RTXNTC (recorded)", "limit": 1, "cuda": False, "unit": "dB"}
    return [
        Goal(TEXTURES, "a step of 65,536 texels with rate term", "texture_torch", *step, 0.25, most=True, unit="ms"),
        Goal(TEXTURES, "the same step in PyTorch, eager", "texture_torch", *eager, 30, of=step),
        *(Goal(TEXTURES, f"above RTXNTC's line, {m}", f"texture_codecs_{m}", **least) for m in recorded.RTXNTC),
        *(whole_goal(name) for name in GRIDS),
        *(storage_goal(material, bits, its) for material in recorded.RTXNTC for bits, its in RTXNTC.items()),
        *(engine_goal(material, bits) for material in recorded.RTXNTC for bits in ENGINE),
    ]


def whole_goal(name: str) -> Goal:
    text = f"all channels of 1024 x 1024 by tensor cores, {name}"
    return Goal(TEXTURES, text, "texture_reading", "whole, float16", name, 0.1, most=True, unit="ms")


def storage_goal(material: str, bits: float, its: float) -> Goal:
    text = f"{bits} bits in memory above RTXNTC's {its}, {material}"
    where = f"texture_storage_{material}", "ahead: PSNR", f"sample {bits:.2f}"
    return Goal(TEXTURES, text, *where, 0.5, cuda=False, unit="dB")


def engine_goal(material: str, bits: float) -> Goal:
    """FLIP that Intel reports of its own set at similar bits."""
    where, most = (f"texture_storage_{material}", "FLIP", f"engine {bits:.2f}"), {5.0: 0.06, 10.0: 0.05}[bits]
    text = f"FLIP of block-compressed latents at {bits:g} bits, {material}"
    return Goal(TEXTURES, text, *where, most, most=True, cuda=False, why=STONES)


GOALS = [*mipmap_goals(), *inference_goals(), *training_goals(), *texture_goals()]

# goals without a figure: the suite holds them
TESTED = {
    MIPMAPS: {
        "gradients of the shader and renders against float64": "test_brdf, test_mipmap",
        "the same seed, the same maps": "test_samples",
    },
    VECTORS: {
        "exact with small integers, bounds for every precision": "test_network, test_operations, test_mlp",
        "CPU against CUDA, divergence, any size and block": "test_divergence, test_network",
    },
    TRAINING: {
        "fused, taped and float64 gradients agree": "test_trainer_gradients, test_training_cpu",
        "checkpoints, resumed runs, bad targets and rates": "test_trainer",
    },
}

# goals on materials and pictures that do not come with the project, and figures of runs apart
ELSEWHERE = {
    MIPMAPS: {
        "displayed error at most 0.7 of the better classical, 1024 to 256 texels": "recorded on an H200:"
        " PavingStones070 0.763, Bark014 0.799, Leather034C 0.679, Bricks060 0.746, Metal053C 0.219. " + MAPS,
        "linear error at most a third of box filtering's, 256 to 64 texels": "recorded on a CPU: PavingStones070 0.073,"
        " Bark014 0.159, Leather034C 0.085, Bricks060 0.140, Metal053C 0.375",
        "linear error at most Toksvig's, 256 to 64 texels": "recorded on a CPU: PavingStones070 0.770, Bark014 0.704,"
        " Leather034C 0.681, Bricks060 0.694, Metal053C 0.348",
    },
    TRAINING: {
        "each step of the network section at least as good as the one before, on slangstars.png": "recorded on a CPU:"
        " 12.0, 17.0, 18.5, 29.4, 36.9 dB",
        "half of tiny-cuda-nn's time with a hash grid": f"missed. {recorded.beside(recorded.HASH_GRIDS)} {GRID}",
        "half of tiny-cuda-nn's time, every other row": "in the same run 0.32 to 0.50 of its time at 2^18 samples, met;"
        " 0.44 to 0.53 at 2^16, missed by some: what does not shrink with the batch is most of a step there. 3x64 takes"
        " at 2^14 still 0.70 of its time at 2^16 (H200)",
    },
}

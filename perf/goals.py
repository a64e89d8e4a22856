"""The goals of the project for speed and, where a sample measures it, quality: what `perf.report` judges.

A goal names the figure that decides it by measurement, row and column, and where it holds: on an H200 or on one core of
a CPU. `why`: what holds the figure back where it misses the goal, and what was tried.
"""

from dataclasses import dataclass

from perf import divergence, inference, training
from perf.networks import SHAPES, shape_name
from perf.results import Result


@dataclass(frozen=True)
class Goal:
    """`limit` in `unit`, which is the figure's; `most`: it must not exceed it. `cuda`: on an H200, else on a CPU.

    of: another figure of the same measurement, row and column, whose multiple the limit is.
    """

    part: str
    text: str
    measurement: str
    row: str
    column: str
    limit: float
    most: bool = False
    cuda: bool = True
    of: tuple[str, str] | None = None
    unit: str = ""
    why: str = ""

    def judge(self, results: dict[str, Result]) -> tuple[str, str, str]:
        """What was measured, the goal, and whether it is met with the distance; in words."""
        result = results.get(self.measurement)
        figure = result and result.find(self.row, self.column)
        base = 1.0
        if self.of:
            other = result and result.find(*self.of)
            figure, base = (figure, other.value) if other else (None, 1.0)
        sign = "at most" if self.most else "at least"
        unit = f" {self.unit}" if self.unit and not self.of else ""
        goal = f"{sign} {self.limit:.3g}" + (f" of {self.of[0]}" if self.of else unit)
        if figure is None:
            return "not measured here", goal, ""
        value = figure.value / base
        met = value <= self.limit if self.most else value >= self.limit
        distance = f"{100 * (value / self.limit - 1):+.0f}%"
        return f"{value:.3g}{unit}", goal, f"**{'met' if met else 'missed'}** ({distance})"


REGISTERS = "Tensor pipe and load/store unit are about equally busy, and registers let few warps overlap them."
F32 = "Packing float32 sums to float16; 161 registers a thread let 12 warps in, and bounds to 128 lose at width 64."
FP8 = "`mma.sync` of FP8 becomes conversions and HMMA on sm_90; Hopper's FP8 units need wgmma."
INT8 = "Instructions between the products: 238 a 64x64 layer beside 32 products, after 370."
FLOOR = "Rows read straight into the network's stage gave 1.2 to 1.27; it needs a second network function."
MAPS = "This shader's maps hold little more: learning displayed error alone ends at 0.735 and 0.778 on two materials."
ONE_BY_ONE = "One input a network: the latency of the weights of 32 networks a warp."

INFERENCE = {
    ("float16, float16 sums", REGISTERS): (360, 420, 500, 540),
    ("float16, float32 sums", F32): (300, 340, 440, 480),
}


def mipmap_goals() -> list[Goal]:
    def whole(text: str, row: str, column: str, limit: float, unit: str = "") -> Goal:
        return Goal("A", text, "samples", row, column, limit, most=True, cuda=False, unit=unit)

    better = "mipmap: displayed error / better"
    iteration = ("An iteration, 2048 to 512, slangpy 0.133", "mipmap", "iteration", "time", 0.10)
    return [
        Goal("A", *iteration, most=True, unit="ms"),
        whole("`samples.mipmap`, empty cache", "mipmap", "command", 60, "s"),
        whole("its memory", "mipmap", "largest memory so far", 1.5, "GB"),
        whole("its linear error against box filtering", "mipmap: linear error / box", "figure", 1 / 3),
        whole("... against Toksvig", "mipmap: linear error / Toksvig", "figure", 1),
        whole("... against SGD", "mipmap: linear error / SGD", "figure", 0.5),
        whole("its displayed error against the better classical", better, "figure", 0.9),
        Goal("A", "`samples.mipmap`, displayed error", "samples", better, "figure", 0.7, most=True, why=MAPS),
    ]


def inference_goals() -> list[Goal]:
    names = [shape_name(*shape) for shape in SHAPES]
    goals = [
        Goal("B", f"{row}, {name}", "inference", row, name, limit, why=why, unit="TFLOP/s")
        for (row, why), limits in INFERENCE.items()
        for name, limit in zip(names, limits, strict=True)
    ]
    goals += [
        Goal("B", "FP8, 3x64", "inference", "e4m3, float16 sums", "3x64", 600, why=FP8, unit="TFLOP/s"),
        Goal("B", "INT8, 3x64", "inference", "int8, float32 sums", "3x64", 600, why=INT8, unit="TFLOP/s"),
    ]
    one = f"{1 << 31:,}"
    for shape, limit in inference.DRIVER.items():
        text, column = f"{shape_name(*shape)}, 2^18 inputs, driver {limit}", f"float16 {shape_name(*shape)}"
        goals.append(Goal("B", text, "divergence", one, column, limit, unit="TFLOP/s"))
    for shape, ms in inference.TINY_CUDA_NN.items():
        name = shape_name(*shape)
        text = f"memory to memory, {name}, tiny-cuda-nn {ms}"
        goals.append(Goal("B", text, "inference", "memory, float16", name, ms, most=True, unit="ms"))
    for name in names[:2]:
        text, floor = f"memory to memory, {name}, of the floor", ("memory, floor", name)
        goals.append(Goal("B", text, "inference", "memory, float16", name, 1.3, most=True, of=floor, why=FLOOR))
    for threads, limit in divergence.DRIVER["3x64"].items():
        if threads < 1 << 31:
            text = f"distinct networks, {threads:,} inputs each, driver {limit}"
            why = ONE_BY_ONE if threads == 1 else REGISTERS
            row, column = f"{threads:,}", "float16 3x64"
            goals.append(Goal("B", text, "divergence", row, column, limit, why=why, unit="TFLOP/s"))
    goals += [
        Goal("B", "first call, empty cache", "compile", "inference, 3x64", "cold", 1, most=True, unit="s"),
        Goal("B", "first call, empty cache", "compile", "inference, 3x64", "cold", 3, most=True, cuda=False, unit="s"),
        Goal(
            "B", "one core, 2x32, float32", "inference", "float32, float32 sums", "2x32", 40, cuda=False, unit="GFLOP/s"
        ),
    ]
    return goals


def training_goals() -> list[Goal]:
    goals = []
    for name, recorded in training.RECORDED.items():
        for batch, ms in recorded.items():
            part, words = (1.0, "") if name in training.ENCODINGS else (0.5, "half of ")
            text = f"a step, {name}, {batch:,} samples, {words}tiny-cuda-nn's {ms}"
            goals.append(Goal("C", text, "training", f"{name}, {batch:,}", "step", part * ms, most=True, unit="ms"))
    for step in range(2, 6):
        row, before = (f"network: psnr step {k:02}" for k in (step, step - 1))
        text = f"`samples.network`, PSNR of step {step} over the one before"
        goals.append(Goal("C", text, "samples", row, "figure", 1, cuda=False, of=(before, "figure")))
    eager = ("PyTorch eager", "training step")
    return [
        *goals,
        Goal(
            "C", "one core, a step of 16,384", "cpu", "Warp Neural", "training step", 1, most=True, cuda=False, of=eager
        ),
        Goal(
            "C", "`samples.network`, empty cache", "samples", "network", "command", 120, most=True, cuda=False, unit="s"
        ),
    ]


GOALS = [*mipmap_goals(), *inference_goals(), *training_goals()]

# goals without a figure: the suite holds them
TESTED = {
    "A: gradients of the shader against finite differences, renders against float64": "test_brdf, test_mipmap",
    "A: the same seed, the same maps": "test_samples",
    "B: exact with small integers, bounds for every precision": "test_network, test_operations, test_mlp",
    "B: CPU against CUDA, divergence, any size and block": "test_divergence, test_network",
    "C: fused, taped and float64 gradients agree": "test_trainer_gradients, test_training_cpu",
    "C: checkpoints, resumed runs, bad targets and rates": "test_trainer",
}

"""Figures that no run of `perf` measures: what others took, recorded once, and what is known of those runs."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Origin:
    """Where figures come from; what is not given was not noted."""

    whose: str
    card: str
    how: str
    date: str
    version: str = ""
    driver: str = ""

    def text(self) -> str:
        known = [
            f"{name} {value or 'not noted'}" for name, value in (("version", self.version), ("driver", self.driver))
        ]
        return f"{self.whose}: {self.card}; {self.how}; {'; '.join(known)}; {self.date}"


H200, FIRST = "NVIDIA H200", "before 22 November 2026"
ORIGINS = [
    Origin("tiny-cuda-nn", H200, "JIT fusion (not for 128 neurons), the faster layout of rows", FIRST),
    Origin("Vulkan driver", H200, "its directed test, `vk_cooperative_vector_perf`, float16", FIRST),
    Origin("Dr.Jit", H200, "cooperative vectors, float16", FIRST),
    Origin("slangpy", H200, "steps through the driver's cooperative vectors; the mip maps' iteration", FIRST),
    Origin("the course", H200, "its own training, an atomic addition a sample and parameter", FIRST),
    Origin("RTXNTC", "NVIDIA H100 or H200", "100,000 steps a file, PSNR of mip 0", "November 2026", version="0.9.2"),
    Origin("tiny-cuda-nn beside Warp Neural", "NVIDIA H100", "both as CUDA graphs in one run", "November 2026"),
]

# tiny-cuda-nn, ms a step by network and samples
TINY_CUDA_NN_STEPS = {
    "2x32": {1 << 18: 0.0850, 1 << 16: 0.0336},
    "3x32": {1 << 18: 0.0844, 1 << 16: 0.0347},
    "2x64": {1 << 18: 0.1320, 1 << 16: 0.0457},
    "3x64": {1 << 18: 0.1594, 1 << 16: 0.0513},
    "3x16": {1 << 18: 0.0663, 1 << 16: 0.0286},
    "3x128": {1 << 18: 0.5253, 1 << 16: 0.1837},
    "frequency": {1 << 18: 0.0776, 1 << 16: 0.0326},
}
# other steps: row, whose it is, ms
OTHER_STEPS = [
    ("2x32, 262,144", "Dr.Jit", 0.203),
    ("3x64, 262,144", "Dr.Jit", 0.741),
    ("3x64, 65,536", "slangpy, 24-64-64-64-3", 0.858),
    ("course step 2, 4,096", "the course", 8.3),
    ("course step 4, 4,096", "the course", 10.6),
]
# tiny-cuda-nn, ms of 2^21 rows, by hidden layers and width
TINY_CUDA_NN_INFERENCE = {
    (2, 32): 0.0806, (3, 32): 0.0848, (2, 64): 0.1604, (3, 64): 0.1983, (3, 16): 0.0459, (3, 128): 0.6223,
}  # fmt: skip
# the Vulkan driver, TFLOP/s, and by threads that share a network
DRIVER = {(2, 32): 223, (3, 32): 313, (2, 64): 434, (3, 64): 497}
DRIVER_SHARED = {
    "3x64": {1 << 31: 497, 16384: 467, 1024: 467, 256: 450, 64: 406, 32: 230, 16: 120, 8: 61, 4: 33, 1: 8.7},
    "2x32": {1 << 31: 223, 16384: 223, 1024: 223, 256: 218, 64: 217, 32: 154, 16: 118, 8: 68, 4: 37, 1: 18.5},
}
# slangpy, ms of an iteration of the mip maps
SLANGPY_MIPMAP = {"as the course calls it": 0.203, "in one command buffer": 0.133}

# RTXNTC by material of ambientCG, 1024 x 1024: bits a texel, network included, and PSNR of all channels
RTXNTC = {
    "PavingStones070": [(1.26, 26.76), (1.81, 27.80), (3.91, 30.63), (6.81, 33.02)],
    "Metal053C": [(1.26, 33.27), (1.81, 35.18), (3.91, 40.17), (6.81, 42.66)],
    "Bricks060": [(1.26, 31.86), (1.81, 32.87), (3.91, 35.86), (6.81, 37.85)],
}


@dataclass(frozen=True)
class Beside:
    """A step of 2^18 samples of both libraries, ms, in one run on one H100, both as CUDA graphs."""

    log2_size: int
    growth: float
    other: float
    ours: float


HASH_GRIDS = [Beside(19, 2.0, 0.730, 0.427), Beside(19, 1.5, 0.571, 0.371), Beside(15, 1.5, 0.442, 0.280)]


def beside(grids: list[Beside]) -> str:
    found = "; ".join(
        f"2^{g.log2_size} entries, growth {g.growth}: {g.ours:.3f} against {g.other:.3f} ms, {g.ours / g.other:.2f}"
        for g in grids
    )
    return f"Recorded on one H100, both as CUDA graphs, 2^18 samples: {found}."

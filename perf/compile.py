"""Time to the first result of a new network: `python -m perf.compile`.

`cold`: in a process with an empty kernel cache; `warm`: in the next one, which finds the kernels there. Warp's own
kernels, the CUDA context and a first module are there beforehand; making the network and its weights is not counted.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass

import numpy as np
import warp as wp

from perf.measure import Bench, Config
from perf.networks import SHAPES, make_net, make_shade_kernel, shape_name
from perf.pictures import bars
from warp_neural import Trainer
from warp_neural.cli import progress, run
from warp_neural.kernels.nn.random import Stream, uniform


@dataclass(frozen=True)
class Case:
    """What a process compiles: inference, or a training step."""

    what: str
    depth: int
    width: int

    @property
    def row(self) -> str:
        return f"{self.what}, {shape_name(self.depth, self.width)}"


@wp.kernel(enable_backward=False)
def first_kernel(y: wp.array[float]):
    y[wp.tid()] = 1.0


def make_sample(width: int) -> wp.Function:
    vec_in, vec_out = wp.types.vector(width, float), wp.types.vector(16, float)

    @wp.func
    def sample(index: int, random: Stream):
        return vec_in(uniform(random, 0)[0]), vec_out(0.5)

    return sample


def first_call(what: str, depth: int, width: int, device: str) -> float:
    """Seconds of the first launch of a network's kernels in this process."""
    wp.config.log_level = wp.LOG_WARNING
    precision = {"accumulation": "float16"} if wp.get_device(device).is_cuda else {"precision": "float32"}
    net, y = make_net(depth, width, seed=0, device=device, **precision), wp.zeros(256, dtype=float, device=device)
    wp.launch(first_kernel, 256, [y], device=device)
    wp.synchronize_device(device)
    begin = time.perf_counter()
    if what == "inference":
        wp.launch(make_shade_kernel(net), 256, [net.params, 30, 0, y], device=device, block_dim=64)
    else:
        trainer = Trainer(net, sample=make_sample(width), batch=256)
        trainer.launches.gradient(0)
        trainer.launches.update()
    wp.synchronize_device(device)
    return time.perf_counter() - begin


def in_new_process(case: Case, device: wp.Device, cache: str) -> float:
    arguments = json.dumps([case.what, case.depth, case.width, device.alias])
    program = f"import json; from perf.compile import first_call; print(first_call(*json.loads({arguments!r})))"
    environment = os.environ | {"WARP_CACHE_PATH": cache, "CUDA_CACHE_DISABLE": "1"}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"compiling {case.row} failed:\n{done.stderr}")
    return float(done.stdout.split()[-1])


def main(config: Config) -> dict:
    bench = Bench("compile", config)
    cuda = bench.device.is_cuda
    bench.result.settings["precision"] = "float16, float16 sums" if cuda else "float32"
    shapes = SHAPES[:1] if config.quick else SHAPES[::3]
    processes = 1 if config.quick or cuda else 2  # CUDA's take many seconds to begin
    bench.result.settings["rounds"] = f"{processes} cold and {processes} warm, medians"
    cases = [*(Case("inference", *shape) for shape in shapes), Case("training step", *shapes[0])]
    for case in progress(cases, config):
        seconds = []
        for _ in range(processes):
            with tempfile.TemporaryDirectory() as cache:
                seconds.append([in_new_process(case, bench.device, cache) for _ in range(2)])
        cold, warm = np.array(seconds).T
        bench.add(case.row, "cold", cold, "s")
        bench.add(case.row, "warm", warm, "s")
    return bench.finish(lambda result: bars(result, "The first call", "s"))


if __name__ == "__main__":
    run(main, Config)

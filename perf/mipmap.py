"""One training iteration of the mip maps: `python -m perf.mipmap`; on CUDA 2048 x 2048 to 512 x 512 texels.

16 reference samples, a backward pass of one light and view pair a texel, the optimizer, the projection. slangpy needs
0.203 ms on an H200 as the course calls it, 0.133 ms recorded in one command buffer. On the CPU 256 x 256 to 64 x 64.
"""

from perf.measure import Bench, Config
from perf.pictures import bars
from perf.recorded import SLANGPY_MIPMAP
from warp_neural.cli import progress, run
from warp_neural.samples.mipmap.classical import toksvig
from warp_neural.samples.mipmap.learn import Learner, Recipe
from warp_neural.samples.mipmap.maps import MaterialConfig, pack, source_maps
from warp_neural.train.optim import Adam

FACTOR = 4


def main(config: Config) -> dict:
    bench = Bench("mipmap", config, precision="float32")
    device, cuda = bench.device, bench.device.is_cuda
    crop = 2048 if cuda else 64 if config.quick else 256
    bench.result.settings["texels"] = f"{(crop // FACTOR) ** 2:,}"
    _name, maps = source_maps(MaterialConfig(crop=crop), device)
    recipe = Recipe(Adam, 0.01, toksvig(maps, FACTOR), uniform_share=0.3, weights=(1.0, 20.0))
    learner = Learner(pack(maps, FACTOR, device), recipe, steps=1000, pairs=1, seed=1)
    parts = {
        "iteration": learner.step,
        "gradient": learner.gradient.launch,
        "optimizer": learner.optimizer.step,
        "projection": learner.project.launch,
    }
    for name, launch in progress(parts.items(), config):
        bench.time(name, "time", launch)
    for name, ms in SLANGPY_MIPMAP.items() if cuda else ():
        bench.recorded(f"slangpy, {name}", "time", ms, "ms")
    return bench.finish(lambda result: bars(result, "An iteration of the mip maps", "ms"))


if __name__ == "__main__":
    run(main, Config)

"""One training iteration of the mip maps on CUDA: 2048 x 2048 to 512 x 512, one pair a texel, in a CUDA graph.

    python -m perf.mipmap

16 reference samples and one backward a texel, the optimizer, the projection: median of 300 replays after 20. Reference:
slangpy needs 0.203 ms as the course calls it, 0.133 ms recorded in one command buffer.
"""

from collections.abc import Callable

import numpy as np
import warp as wp

from samples.mipmap.classical import toksvig
from samples.mipmap.learn import Learner, Recipe
from samples.mipmap.maps import MaterialConfig, pack, source_maps
from warp_neural.optim import Adam

REPLAYS, WARM_UP, SLANGPY_MS = 300, 20, 0.133


def milliseconds(launch: Callable[[], None], device: wp.Device) -> np.ndarray:
    """One time per replay of a graph of `launch`, sorted."""
    launch()  # compiles
    with wp.ScopedCapture(device=device) as capture:
        launch()
    times = []
    for _ in range(WARM_UP + REPLAYS):
        begin, end = (wp.Event(device, enable_timing=True) for _ in range(2))
        wp.record_event(begin)
        wp.capture_launch(capture.graph)
        wp.record_event(end)
        times.append((begin, end))
    wp.synchronize_device(device)
    return np.sort([wp.get_event_elapsed_time(*pair) for pair in times[WARM_UP:]])


def main() -> None:
    device = wp.get_device("cuda:0")
    _name, maps = source_maps(MaterialConfig(crop=2048), device)
    recipe = Recipe(Adam, 0.01, toksvig(maps, 4), uniform_share=0.3, weights=(1.0, 20.0))
    learner = Learner(pack(maps, 4, device), recipe, steps=1000, pairs=1, seed=1)
    parts = {
        "iteration": learner.step,
        "gradient": learner.gradient.launch,
        "optimizer": learner.optimizer.step,
        "projection": learner.project.launch,
    }
    print(f"{device.name}, Warp {wp.__version__}, float32, 262,144 texels, {REPLAYS} replays, {WARM_UP} dropped\n")
    print(f"| part | median, ms | 10 to 90 % | of slangpy's {SLANGPY_MS} ms |")
    print("|---|---|---|---|")
    with wp.ScopedDevice(device):
        for name, launch in parts.items():
            times = milliseconds(launch, device)
            low, median, high = times[[len(times) // 10, len(times) // 2, 9 * len(times) // 10]]
            print(f"| {name} | {median:.4f} | {low:.4f} to {high:.4f} | {median / SLANGPY_MS:.2f} |")


if __name__ == "__main__":
    main()

"""`Renderer`: adds samples to a picture, as many as one has time for; `render` does it all."""

import os
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Literal

import numpy as np
import warp as wp
from tqdm import tqdm

from warp_neural.config import Struct, check_device
from warp_neural.errors import InputError, find_device
from warp_neural.kernels.errors import LARGEST, LARGEST_SEED, is_finite, require, require_whole
from warp_neural.kernels.render.path import LIGHT, MATERIAL, MIS, Film, View, make_path_kernel
from warp_neural.render.camera import Camera, Vector, vector
from warp_neural.render.environment import Environment
from warp_neural.render.materials import count_of, functions_of, texels_of
from warp_neural.render.picture import Picture
from warp_neural.render.scene import Scene

STRATEGIES = {"mis": MIS, "light": LIGHT, "material": MATERIAL}
BAND = 4096  # pixels of a launch on the CPU
MOST_PIXELS = 2**28
PASS_SECONDS = 0.5  # of what is launched before the bar moves
LARGEST_PASS = 1024  # samples

Strategy = Literal["mis", "light", "material"]


class Renderer:
    """Samples of a scene, summed in float64.

    Sample n of a pixel is a function of `seed`, n and the pixel: pictures do not depend on how samples are parted into
    calls of `add`. On the CPU bands of rows run on all cores.
    size: width and height in pixels. For the other arguments see `render`.
    """

    def __init__(
        self,
        scene: Scene,
        materials: Any,
        environment: Environment,
        camera: Camera,
        size: tuple[int, int],
        *,
        depth: int = 8,
        background: Vector | None = None,
        clamp: float | None = None,
        strategy: Strategy = "mis",
        seed: int = 0,
        device: wp.DeviceLike = None,
    ):
        width, height = _checked_size(size)
        require_whole("depth", depth, 1, 1000)
        require_whole("seed", seed, 0, LARGEST_SEED)
        require(clamp is None or (is_finite(clamp) and clamp > 0), "clamp", clamp, "a number above 0, or None")
        require(strategy in STRATEGIES, "strategy", strategy, ", ".join(map(repr, STRATEGIES)))
        self.scene, self.materials, self.seed, self.samples, self.seconds = scene, materials, seed, 0, 0.0
        self.device = find_device(device)
        _check_materials(scene, materials, self.device)
        self.kernel = make_path_kernel(functions_of(materials))
        wp.load_module(self.kernel.module, device=self.device)  # compiling is not counted as rendering
        self.view = view = View()
        view.geometry, view.environment = scene.data(self.device), environment.data(self.device)
        view.camera, view.depth, view.strategy = camera.data(width, height), depth, int(STRATEGIES[strategy])
        view.plain = background is not None
        view.background = wp.vec3(*vector("background", background or (0.0, 0.0, 0.0)))
        view.limit = np.inf if clamp is None else clamp
        detail = np.log2(texels_of(materials, scene.material_count))
        view.detail = wp.array(detail, dtype=float, device=self.device)
        self.film = _film(height, width, self.device)

    def add(self, samples: int) -> None:
        """So many more of each pixel."""
        require_whole("samples", samples, 1, LARGEST - self.samples)
        began = time.perf_counter()
        height, width = self.film.radiance.shape
        rows = height if self.device.is_cuda else max(BAND // width, 1)
        commands = []
        for top in range(0, height, rows):
            inputs = [self.materials.params, self.view, self.seed, self.samples, samples, top, self.film]
            dim = min(rows, height - top), width
            commands.append(wp.launch(self.kernel, dim, inputs, device=self.device, record_cmd=True))
        if len(commands) == 1:
            commands[0].launch()
        else:
            with ThreadPoolExecutor(os.cpu_count()) as pool:
                for done in [pool.submit(command.launch) for command in commands]:
                    done.result()
        wp.synchronize_device(self.device)
        self.samples += samples
        self.seconds += time.perf_counter() - began

    def picture(self) -> Picture:
        """Of the samples so far."""
        require(self.samples > 0, "samples", self.samples, "at least one before there is a picture; call add")
        means = {
            name: (getattr(self.film, name).numpy() / self.samples).astype(np.float32)
            for name in ("radiance", "albedo", "normal")
        }
        alpha = (self.film.hits.numpy() / self.samples).astype(np.float32)
        dropped = int(self.film.dropped.numpy().sum())
        return Picture(**means, alpha=alpha, samples=self.samples, dropped=dropped, seconds=self.seconds)


def render(
    scene: Scene,
    materials: Any,
    environment: Environment,
    camera: Camera,
    size: tuple[int, int],
    *,
    samples: int = 64,
    seconds: float | None = None,
    depth: int = 8,
    background: Vector | None = None,
    clamp: float | None = None,
    strategy: Strategy = "mis",
    seed: int = 0,
    quiet: bool = True,
    device: wp.DeviceLike = None,
) -> Picture:
    """A picture of `size` (width, height), each pixel the mean of `samples` paths, deterministic by `seed`.

    materials: a set of them, see `wn.render.materials`, its parameters on `device`. seconds: after which no more
    samples begin, one is always taken; `Picture.samples` says how many there were. depth: surfaces of a path at most.
    background: what the camera sees instead of the environment. clamp: of what a surface adds in one sample, in each
    channel; darkens, and is not needed where materials sample well. strategy: of direct light, by both environment and
    material, or by one alone. quiet: no progress bar, which there is none of without a terminal.
    """
    require_whole("samples", samples, 1, LARGEST)
    require(seconds is None or (is_finite(seconds) and seconds > 0), "seconds", seconds, "a number above 0, or None")
    options = {"depth": depth, "background": background, "clamp": clamp, "strategy": strategy, "seed": seed}
    renderer = Renderer(scene, materials, environment, camera, size, **options, device=device)
    _run(renderer, samples, seconds, quiet)
    return renderer.picture()


def _run(renderer: Renderer, samples: int, seconds: float | None, quiet: bool) -> None:
    began, count = time.perf_counter(), 1
    with tqdm(total=samples, disable=True if quiet else None, file=sys.stderr, unit="sample") as bar:
        while renderer.samples < samples:
            before = time.perf_counter()
            renderer.add(min(count, samples - renderer.samples))
            bar.update(renderer.samples - bar.n)
            now = time.perf_counter()
            if seconds is not None and now - began >= seconds:
                break
            aim = PASS_SECONDS if seconds is None else min(PASS_SECONDS, began + seconds - now)
            count = int(np.clip(count * aim / max(now - before, 1e-6), 1, min(2 * count, LARGEST_PASS)))


def _checked_size(size: tuple[int, int]) -> tuple[int, int]:
    try:
        width, height = size
    except (TypeError, ValueError):
        raise InputError(f"size={size!r}: expected (width, height)") from None
    require_whole("width", width, 1, 2**16)
    require_whole("height", height, 1, 2**16)
    require(width * height <= MOST_PIXELS, "size", size, f"at most {MOST_PIXELS} pixels in all")
    return width, height


def _check_materials(scene: Scene, materials: Any, device: wp.Device) -> None:
    count = count_of(materials)
    if count is not None and scene.material_count > count:
        raise InputError(f"materials: {count} of them, and the scene has one of number {scene.material_count - 1}")
    functions_of(materials)
    given = getattr(materials.params, "_cls", None)
    if given is not materials.Params:
        raise InputError(f"materials: params is a {type(materials.params).__name__}, and no instance of Params")
    _check_arrays("materials", materials.Params, materials.params, device)


def _check_arrays(name: str, struct: Struct, value: Any, device: wp.Device) -> None:
    check_device(name, struct, value, device)
    for member, variable in struct.vars.items():
        if isinstance(variable.type, Struct):
            _check_arrays(f"{name}.{member}", variable.type, getattr(value, member), device)


def _film(height: int, width: int, device: wp.Device) -> Film:
    film = Film()
    for name in ("radiance", "albedo", "normal"):
        setattr(film, name, wp.zeros((height, width), dtype=wp.vec3d, device=device))
    for name in ("hits", "dropped"):
        setattr(film, name, wp.zeros((height, width), dtype=int, device=device))
    return film

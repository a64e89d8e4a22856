"""Neural textures read by a renderer and decoded whole: `python -m perf.texture_reading`.

A frame of the scene of `samples.textured_scene`, 1920 x 1080, whose texture has 7 channels and all mip levels: on
sample, one texel by chance or filtered exactly; for engines; on load, as codes and in blocks; on feedback, its cache
warm, beside its update. With each the bytes that it takes on the device. Then all channels of a texture decoded by
tensor cores, a thread each texel beside it; on the CPU by rows. Latents and weights are random: only time is measured.
"""

from collections.abc import Callable

import numpy as np
import warp as wp

import warp_neural as wn
from perf.measure import WARM_UP, Bench, Config, check, wall_ms
from perf.pictures import bars
from warp_neural.cli import progress, run
from warp_neural.kernels.texture.block_latents import PARAMETERS, STEPS
from warp_neural.kernels.texture.spec import BlockSpec, TextureSpec
from warp_neural.samples.textured_scene.fetch import make_exact_fetch
from warp_neural.samples.textured_scene.scene import Renderer, camera_at, to_8_bit
from warp_neural.texture import EngineTexture, Texture
from warp_neural.texture.block_state import BlockState, to_bc1
from warp_neural.texture.presets import BLOCKS, FEW, FIXED, MANY
from warp_neural.texture.state import Map, Tensor, TextureState

KINDS = {"albedo": ("srgb", 3), "normal": ("normal", 3), "roughness": ("linear", 1), "height": ("linear", 1)}
RATE = 3.75  # of latents on sample; of engines 5
GRIDS = {"about 1 bit": FEW, "2 bits and more": MANY} | {
    f"sample {bits:g}": FIXED[bits] for bits in (1.625, 3.75, 6.4375)
}
FLOAT16 = 2e-3  # relative error of a decoded picture


def maps_of(channels: int) -> tuple[Map, ...]:
    kinds = list(KINDS.items())[: 3 if channels == 7 else 4]
    return tuple(Map(name, kind, (0.0,) * n, (1.0,) * n) for name, (kind, n) in kinds)


def tensors_of(spec: TextureSpec | BlockSpec, random: np.random.Generator) -> dict[str, Tensor]:
    tensors = {}
    for name, shape in spec.tensors.items():
        spread = 0.3 if name.startswith("kernel") else 0.1 if name.startswith("biases") else np.sqrt(2 / shape[-1])
        tensors[name] = Tensor(np.rint(random.normal(0, 128, shape)).astype(np.int32), float(np.float16(spread / 128)))
    return tensors


def random_texture(spec: TextureSpec, device: wp.Device, seed: int) -> Texture:
    random = np.random.default_rng(seed)

    def latents(mip: int, g: int) -> np.ndarray:
        grid = spec.grids[g]
        values = random.integers(-min(grid.limit, 7), min(grid.limit, 7) + 1, (*spec.cells(mip, g), grid.channels))
        return np.where(values < 0, -1, 1).astype(np.int8) if grid.bits == 1 else values.astype(np.int8)

    levels = tuple(tuple(latents(mip, g) for g in range(len(spec.grids))) for mip in range(spec.mips))
    return Texture(TextureState(spec, levels, tensors_of(spec, random), maps_of(spec.channels)), device)


def random_engine(spec: BlockSpec, device: wp.Device, seed: int) -> EngineTexture:
    random, most = np.random.default_rng(seed), np.array([*STEPS, *STEPS, *[3] * 16])

    def level(mip: int, g: int) -> np.ndarray:
        return to_bc1(most * random.random((int(np.prod(spec.blocks(mip, g))), PARAMETERS)))

    blocks = tuple(tuple(level(mip, g) for mip in range(spec.mips)) for g in range(len(spec.scales)))
    return EngineTexture(BlockState(spec, blocks, tensors_of(spec, random), maps_of(spec.channels)), device)


def main(config: Config) -> dict:
    bench = Bench("texture_reading", config)
    side, size, whole = (2048, (1080, 1920), 1024) if bench.device.is_cuda else (256, (120, 180), 256)
    side, size, whole = (32, (16, 24), 32) if config.quick else (side, size, whole)
    texels, pixels = f"{side} x {side}, decoded whole {whole} x {whole}", f"{size[1]} x {size[0]}"
    bench.result.settings |= {"texels": texels, "pixels": pixels, "bits on sample": str(RATE)}
    add_frames(bench, config, side, size)
    for name, grids in progress(list(GRIDS.items())[: 1 if config.quick else None], config, desc="whole pictures"):
        add_whole(bench, config, name, TextureSpec(whole, whole, 8, 1, grids))
    return bench.finish(lambda result: bars(result, "Reading and decoding neural textures", "ms"))


def add_frames(bench: Bench, config: Config, side: int, size: tuple[int, int]) -> None:
    texture = random_texture(TextureSpec(side, side, 7, side.bit_length(), FIXED[RATE]), bench.device, config.seed)
    engine = random_engine(BlockSpec(side, side, 7, side.bit_length(), BLOCKS[5.0]), bench.device, config.seed)
    virtual = wn.texture.VirtualTexture(texture, budget=2**30)
    others = {
        "on sample, exact": texture,
        "for engines": engine,
        "on load, codes": wn.texture.CodedMaps(texture),
        "on load, BC7 BC5 BC4": wn.texture.BlockMaps(texture),
        "on load, BC1": wn.texture.BlockMaps(texture, bc1=True),
        "on feedback, warm": virtual,
    }
    ways = {"on sample": (texture, texture.make_sampler())}
    ways |= {name: (maps, make_exact_fetch(maps)) for name, maps in others.items()}
    camera, pictures = camera_at(0.0), {}
    for name, (maps, fetch) in progress(ways.items(), config, desc="frames"):
        renderer = Renderer(fetch, maps.Params, maps.params, bench.device, *size)
        if maps is virtual:
            warm(virtual, lambda: renderer.render(camera))  # noqa: B023
        pictures[name] = to_8_bit(renderer.render(camera)[0], bench.device)
        bench.time(name, "frame", lambda: renderer.render(camera))  # noqa: B023
        bench.add(name, "memory", (virtual.used_bytes if maps is virtual else maps.bytes) / 2**20, "MiB")
    difference = np.abs(pictures["on feedback, warm"] - pictures["on load, codes"]).max(axis=-1)
    if difference.max() > 1.01 / 255:  # float32 sums in another order
        raise RuntimeError(
            f"on feedback: the warm cache's picture is {255 * difference.max():.0f}/255 off that of on load"
        )
    bench.add("on feedback, warm", "pixels off by 1/255", int((difference > 0).sum()), "")
    updates = [wall_ms(virtual.update, 1) for _ in range(WARM_UP + config.rounds)][WARM_UP:]
    bench.add("on feedback, warm", "update", np.array(updates), "ms")


def warm(virtual: wn.texture.VirtualTexture, render: Callable) -> None:
    while render() and virtual.update().misses:
        pass


def add_whole(bench: Bench, config: Config, name: str, spec: TextureSpec) -> None:
    texture = random_texture(spec, bench.device, config.seed)
    shape, rectangle = (*spec.size(0), spec.channels), (0, 0, spec.width, spec.height)
    alone = wp.empty(shape, dtype=float, device=bench.device)
    slow = lambda: texture.decoder.decode_alone(0, rectangle, alone)  # noqa: E731
    slow()
    for dtype in (wp.float32, wp.float16, wp.uint8) if bench.device.is_cuda else (wp.float32,):
        values = wp.empty(shape, dtype=dtype, device=bench.device)
        texture.decode_to(values)
        if dtype is not wp.uint8:
            check(name, values.numpy(), alone.numpy(), FLOAT16)
        bench.time(f"whole, {dtype.__name__}", name, lambda: texture.decode_to(values))  # noqa: B023
    bench.time("whole, a thread each texel", name, slow)


if __name__ == "__main__":
    run(main, Config)

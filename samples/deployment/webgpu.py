"""Exported shaders through wgpu, on whatever driver there is; other languages than WGSL through their compilers."""

import os
import shutil
import subprocess
import time
from collections.abc import Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from warp_neural.export.images import SIDE
from warp_neural.export.shaders import GROUP
from warp_neural.export.spirv import slangc
from warp_neural.imaging.block_texture import BlockTexture

LANGUAGES = "wgsl", "glsl", "hlsl", "slang"
BLOCKS, HALF = "texture-compression-bc", "shader-f16"


@cache
def device():
    """Of wgpu, or None."""
    if not find_spec("wgpu"):
        return None
    import wgpu

    try:
        adapter = wgpu.gpu.request_adapter_sync()
        return adapter.request_device_sync(required_features=list({BLOCKS, HALF} & adapter.features))
    except RuntimeError:
        return None


def missing(language: str) -> str | None:
    """What it takes to run a language's shaders and is not there."""
    if device() is None:
        return "wgpu with a driver"
    if language in ("glsl", "hlsl") and not shutil.which("glslangValidator"):
        return "glslangValidator"
    return "slangc (slangtorch)" if language == "slang" and not slangc() else None


def compiled(language: str, source: Path, folder: Path) -> str | bytes:
    """As WebGPU takes it. Slang by WGSL: slangtorch's compiler lacks an optimizer of SPIR-V, on which drivers hang.

    Raises RuntimeError with what a compiler says."""
    if language == "wgsl":
        return source.read_text()
    result, environment = folder / f"{source.stem}.{language}.result", dict(os.environ)
    options = ["-D", "-S", "comp", "-e", "main"] if language == "hlsl" else []
    command = ["glslangValidator", "-V", str(source), *options]
    if language == "slang":
        environment["LD_LIBRARY_PATH"] = str(slangc().parent)
        command = [str(slangc()), str(source), "-target", "wgsl", "-entry", "main", "-stage", "compute"]
    done = subprocess.run([*command, "-o", str(result)], capture_output=True, text=True, env=environment)
    if done.returncode:
        raise RuntimeError(f"{source}: {done.stdout}{done.stderr}")
    return result.read_text() if language == "slang" else result.read_bytes()


def evaluate(
    code: str | bytes, weights: np.ndarray, inputs: np.ndarray, n_out: int, textures: Sequence[BlockTexture] = ()
) -> tuple[np.ndarray, float]:
    """Results [rows, n_out] of inputs [rows, n_in], float32, and the seconds of a second run, copies included.

    textures: latent textures of a neural texture, BC1."""
    import wgpu

    usage, size = wgpu.BufferUsage, 4 * len(inputs) * n_out
    results = device().create_buffer(size=size, usage=usage.STORAGE | usage.COPY_SRC)
    pipeline, group = prepared(code, {**stored(weights, 0), **stored(inputs, 1), 2: whole(results)})
    if textures:
        latents = bound(textures, pipeline.get_bind_group_layout(1))
    for _ in range(2):
        began, encoder = time.perf_counter(), device().create_command_encoder()
        commands = encoder.begin_compute_pass()
        commands.set_pipeline(pipeline)
        commands.set_bind_group(0, group)
        if textures:
            commands.set_bind_group(1, latents)
        commands.dispatch_workgroups(-(-len(inputs) // GROUP))
        commands.end()
        device().queue.submit([encoder.finish()])
        found = np.frombuffer(device().queue.read_buffer(results), np.float32)
    return found.reshape(len(inputs), n_out), time.perf_counter() - began


def fill(code: str | bytes, weights: np.ndarray, width: int, height: int) -> np.ndarray:
    """The image that an exported entry fills, float16 [height, width, 4]."""
    import wgpu

    usage = wgpu.TextureUsage.STORAGE_BINDING | wgpu.TextureUsage.COPY_SRC
    image = device().create_texture(size=(width, height, 1), format="rgba16float", usage=usage)
    pipeline, group = prepared(code, {**stored(weights, 0), 1: image.create_view()})
    encoder = device().create_command_encoder()
    commands = encoder.begin_compute_pass()
    commands.set_pipeline(pipeline)
    commands.set_bind_group(0, group)
    commands.dispatch_workgroups(-(-width // SIDE), -(-height // SIDE))
    commands.end()
    device().queue.submit([encoder.finish()])
    layout = {"bytes_per_row": 8 * width, "rows_per_image": height}
    data = device().queue.read_texture({"texture": image}, layout, (width, height, 1))
    return np.frombuffer(data, np.float16).reshape(height, width, 4)


def prepared(code: str | bytes, resources: dict):
    """The pipeline of a shader, and its first group, of resources by their bindings."""
    kernel = {"module": device().create_shader_module(code=code), "entry_point": "main"}
    pipeline = device().create_compute_pipeline(layout="auto", compute=kernel)
    entries = [{"binding": binding, "resource": resource} for binding, resource in resources.items()]
    return pipeline, device().create_bind_group(layout=pipeline.get_bind_group_layout(0), entries=entries)


def stored(values: np.ndarray, binding: int) -> dict:
    """A buffer by its binding; none for no values."""
    import wgpu

    if not values.size:
        return {}
    return {binding: whole(device().create_buffer_with_data(data=values, usage=wgpu.BufferUsage.STORAGE))}


def whole(buffer) -> dict:
    return {"buffer": buffer, "offset": 0, "size": buffer.size}


def bound(textures: Sequence[BlockTexture], layout):
    """A group of a sampler, linear and repeating, and of textures."""
    import wgpu

    linear = dict.fromkeys(("mag_filter", "min_filter", "mipmap_filter"), "linear")
    repeat = dict.fromkeys(("address_mode_u", "address_mode_v"), "repeat")
    resources = [device().create_sampler(**linear, **repeat)]
    usage = wgpu.TextureUsage.TEXTURE_BINDING | wgpu.TextureUsage.COPY_DST
    for each in textures:
        size = each.width, each.height, 1
        texture = device().create_texture(
            size=size, format="bc1-rgba-unorm", usage=usage, mip_level_count=len(each.levels)
        )
        for mip, level in enumerate(each.levels):
            rows, columns = (-(-side // 4) for side in each.size(mip))
            layout_of_data = {"bytes_per_row": 8 * columns, "rows_per_image": rows}
            place = {"texture": texture, "mip_level": mip}
            device().queue.write_texture(place, level, layout_of_data, (4 * columns, 4 * rows, 1))
        resources.append(texture.create_view())
    entries = [{"binding": i, "resource": resource} for i, resource in enumerate(resources)]
    return device().create_bind_group(layout=layout, entries=entries)

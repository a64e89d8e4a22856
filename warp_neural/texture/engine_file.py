"""Neural textures for engines in files: latents in DDS or KTX 2.0, and a network that says how to read them.

The network's file is one of `warp_neural.nn.network_file`; `extra["texture"]` in its metadata holds the size, the maps,
and of each latent texture its file's name and CRC-32. Inputs of the network are 4 (c - 1/2) of red, green and blue of
each latent texture, c from 0 to 1, bilinearly filtered, and, if there are mip levels, the level / 8.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from warp_neural.errors import InputError
from warp_neural.imaging.block_files import load_blocks
from warp_neural.imaging.block_texture import BlockTexture
from warp_neural.imaging.dds import write_dds
from warp_neural.imaging.ktx2 import write_ktx2
from warp_neural.kernels.texture.spec import BlockSpec
from warp_neural.nn.network_file import read_state, write_state
from warp_neural.nn.state import NetworkState
from warp_neural.texture.block_state import BlockState
from warp_neural.texture.decoder import network_of
from warp_neural.texture.header import maps_of_json, maps_to_json
from warp_neural.texture.save import File
from warp_neural.texture.state import Tensor

SUFFIX = ".safetensors"
_WRITERS = {"dds": write_dds, "ktx2": write_ktx2}


def save_engine(path: Path | str, state: BlockState, file: File = "dds") -> dict[str, Any]:
    """Each file whole or not at all, the network last. Returns the bytes of the network, of each latent texture, and
    of all. Raises `InputError` for a path without the suffix."""
    path = Path(path)
    if path.suffix != SUFFIX:
        raise InputError(f"{path}: a texture for engines is a network's file, with latents beside it; name it {SUFFIX}")
    latents = []
    for g in range(len(state.spec.scales)):
        beside = path.with_name(f"{path.stem}_latent_{g}.{file}")
        _WRITERS[file](beside, latent_texture(state, g))
        latents.append({"file": beside.name, "crc32": crc32(beside.read_bytes())})
    spec = state.spec
    texture = {"height": spec.height, "width": spec.width, "mips": spec.mips, "scales": spec.scales}
    texture |= {"maps": maps_to_json(state.maps), "latents": latents, "metrics": dict(state.extra)}
    texture["steps"] = {name: state.tensors[name].step for name in spec.tensors}
    write_state(path, replace(network_of(state, "cpu").state, extra={"texture": texture}))
    sizes = [path.with_name(each["file"]).stat().st_size for each in latents]
    network = path.stat().st_size
    return {"network": network, "latents": sizes, "all": network + sum(sizes)}


def latent_texture(state: BlockState, g: int) -> BlockTexture:
    """As files and graphics interfaces have it."""
    rows, columns = state.spec.latents(0, g)
    return BlockTexture("bc1", rows, columns, tuple(level.astype("<u4").tobytes() for level in state.blocks[g]))


def load_engine(path: Path | str) -> BlockState:
    """What `save_engine` wrote. Raises `InputError` that names the file for a network of another kind, and for latent
    textures that are missing, damaged or of another texture."""
    network = read_state(path)
    return engine_state(Path(path), network)


def engine_state(path: Path, network: NetworkState) -> BlockState:
    """Of the network that was read from `path`."""
    texture = network.extra.get("texture")
    if not isinstance(texture, Mapping):
        raise InputError(f"{path}: a network without a texture; give a file of compress")
    try:
        numbers = (texture[name] for name in ("height", "width"))
        hidden, channels = tuple(network.spec.sizes[1:-1]), network.spec.sizes[-1]
        spec = BlockSpec(*numbers, channels, texture["mips"], tuple(texture["scales"]), hidden)
        maps, steps, metrics = maps_of_json(texture["maps"]), texture["steps"], dict(texture["metrics"])
        latents = [(str(each["file"]), each["crc32"]) for each in texture["latents"]]
        pairs = zip(spec.tensors, _parameters(network), strict=True)
        tensors = {name: _tensor(values, steps[name]) for name, values in pairs}
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(f"{path}: its texture cannot be read ({error}); write it again") from error
    if len(latents) != len(spec.scales) or spec.n_in != network.spec.sizes[0]:
        raise InputError(f"{path}: {len(latents)} latent textures do not fit the network; write it again")
    blocks = tuple(_blocks(path, spec, g, *each) for g, each in enumerate(latents))
    try:
        return BlockState(spec, blocks, tensors, maps, metrics)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _parameters(network: NetworkState) -> list[np.ndarray]:
    """In the order of `BlockSpec.tensors`."""
    return [array for layer in zip(network.weights, network.biases, strict=True) for array in layer]


def _tensor(values: np.ndarray, step: float) -> Tensor:
    if not (isinstance(step, float) and step > 0):
        raise ValueError(f"a step of {step!r}")
    return Tensor(np.rint(np.float64(values) / step).astype(np.int32), step)


def _blocks(path: Path, spec: BlockSpec, g: int, name: str, checksum: int) -> tuple[np.ndarray, ...]:
    beside = path.with_name(Path(name).name)  # never elsewhere
    texture = load_blocks(beside)
    if crc32(beside.read_bytes()) != checksum:
        raise InputError(f"{beside}: not the latent texture that {path.name} was written with; write both again")
    size = (texture.height, texture.width, len(texture.levels))
    if texture.format != "bc1" or size != (*spec.latents(0, g), spec.mips):
        raise InputError(f"{beside}: {texture.format} of another size than {path.name} says; write both again")
    return tuple(np.frombuffer(level, "<u4").reshape(-1, 2).astype(np.uint32) for level in texture.levels)

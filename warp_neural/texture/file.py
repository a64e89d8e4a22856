"""Textures in `.wntc` files, whole or not at all, and all or a part of them back; the format is in docs/wntc.md."""

from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from warp_neural.errors import InputError
from warp_neural.io.files import atomic_path
from warp_neural.kernels.texture.spec import TextureSpec
from warp_neural.texture import blocks as block_index
from warp_neural.texture import contexts, header, numbers
from warp_neural.texture.blocks import Blocks, Streams
from warp_neural.texture.coder import encode_grid
from warp_neural.texture.contexts import Context
from warp_neural.texture.decode_blocks import decode_mips
from warp_neural.texture.fit import fit
from warp_neural.texture.header import Header
from warp_neural.texture.sections import FileBytes, Reader, section
from warp_neural.texture.state import Tensor, TextureState

MAGIC, VERSION = b"WNTC", 1
SECTIONS = ("header", "network", "contexts", "index")  # before the latents
BLOCK = 256  # texels of a block's side

Latents = Sequence[Sequence[np.ndarray]]


def save_state(path: Path | str, state: TextureState) -> dict[str, Any]:
    """Write a file; on a full disk the old one stays. Returns the bytes of its parts: header, network, contexts, index,
    latents (of each mip, of each grid), all."""
    parts = _parts(state)
    data = _joined(parts)
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)
    latents = [[sum(map(len, grid)) for grid in mip] for mip in parts.pop("latents")]
    return {name: len(part) for name, part in parts.items()} | {"latents": latents, "all": len(data)}


def to_bytes(state: TextureState) -> bytes:
    """The content of its file."""
    return _joined(_parts(state))


def coded_bits(state: TextureState) -> int:
    """The size of its file."""
    return 8 * len(to_bytes(state))


def load_state(path: Path | str, device: wp.DeviceLike = "cpu") -> TextureState:
    """Read a file; its latents are decoded on `device`, to the same integers on each.

    Raises `InputError` that names the file and the part for files of newer versions, other files and damaged ones.
    """
    file = TextureFile(path)
    latents = decode_mips(file, range(file.spec.mips), None, device)
    return TextureState(file.spec, tuple(latents), file.tensors, file.maps, file.extra)


class TextureFile:
    """A file of which parts are read when they are asked for: `latents`. spec, maps, extra, tensors: as in the state.

    Raises `InputError` as `load_state` does.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.data = FileBytes(self.path)
        reader = Reader(self.path, "header", self.data)
        _check_version(reader)
        ends = [0]
        self.header = header.unpack(reader.section("header", 0))
        ends.append(reader.at)
        self.spec, self.maps, self.extra = self.header.spec, self.header.maps, self.header.extra
        self.blocks = Blocks(self.spec, self.header.block)
        self.tensors: Mapping[str, Tensor] = _unpack_network(reader.section("network"), self.spec)
        ends.append(reader.at)
        self.contexts: list[Context] = contexts.unpack(reader.section("contexts"), self.spec)
        ends.append(reader.at)
        inside = reader.section("index")
        ends.append(reader.at)
        self.sections = dict(zip(SECTIONS, np.diff(ends).tolist(), strict=True))
        self.streams: dict[tuple[int, int], Streams] = block_index.unpack_index(inside, self.blocks, reader.at)
        reader.part, (last, *_) = "latents", reversed(self.streams.values())
        end = int(last.starts[-1] + last.sizes[-1])
        reader.require(len(self.data) >= end, f"cut short at {len(self.data)} of {end} bytes")
        reader.require(len(self.data) == end, f"{len(self.data) - end} bytes too many")

    @property
    def sizes(self) -> dict[str, Any]:
        """Bytes of its parts, as `save_state` has them."""
        spec = self.spec
        latents = [[int(self.streams[mip, g].sizes.sum()) for g in range(len(spec.grids))] for mip in range(spec.mips)]
        return self.sections | {"latents": latents, "all": len(self.data)}

    def latents(
        self, mip: int, rectangle: tuple[int, int, int, int] | None = None, device: wp.DeviceLike = "cpu"
    ) -> tuple[np.ndarray, ...]:
        """int8 [rows, columns, channels] of each grid of a mip; of a rectangle (left, top, width, height, in texels of
        the mip) the cells that it reads: of top // scale to one beyond (top + height - 1) // scale, wrapping."""
        return decode_mips(self, [mip], rectangle, device)[0]


def _check_version(reader: Reader) -> None:
    path, start = reader.path, reader.data[0:5]
    if start[:4] != MAGIC:
        raise InputError(f"{path}: not a neural texture of Warp Neural; check the name")
    reader.bytes(5)
    if start[4] > VERSION:
        raise InputError(f"{path}: version {start[4]} of the format, written by a newer version; update warp-neural")
    reader.require(start[4] == VERSION, "an unknown version")


def _parts(state: TextureState) -> dict[str, Any]:
    fitted, streams, order = _coded(state.spec, state.latents)
    head = header.pack(Header(state.spec, BLOCK, state.maps, state.extra))
    return {
        "header": section(head, MAGIC + bytes([VERSION])),
        "network": section(_pack_network(state)),
        "contexts": section(contexts.pack(fitted)),
        "index": section(block_index.pack_index([stream for mip, g in order for stream in streams[mip][g]])),
        "latents": streams,
    }


def _joined(parts: dict[str, Any]) -> bytes:
    latents = chain.from_iterable(grid for mip in parts["latents"] for grid in reversed(mip))
    return b"".join([*(parts[name] for name in SECTIONS), *latents])


def _coded(spec: TextureSpec, latents: Latents) -> tuple[list[Context], list, list[tuple[int, int]]]:
    """(contexts, streams of each mip, grid and block, the order of mips and grids in the file)."""
    blocks, n = Blocks(spec, BLOCK), len(spec.grids)
    latents = [
        [(each + 1) // 2 if grid.bits == 1 else each for each, grid in zip(mip, spec.grids, strict=True)]
        for mip in latents
    ]
    used = [np.any([mip[g].any((0, 1)) for mip in latents], 0) for g in range(n)]
    live = [[np.ascontiguousarray(mip[g][..., used[g]]) for g in range(n)] for mip in latents]
    above = [[*mip[1:], mip[-1][..., :0]] for mip in live]
    fitted = [fit([mip[g] for mip in live], [mip[g] for mip in above], blocks.side(g), used[g]) for g in range(n)]
    streams = [
        [
            encode_grid(live[mip][g], above[mip][g], fitted[g].integers, blocks.places(mip, g), blocks.side(g))
            for g in range(n)
        ]
        for mip in range(spec.mips)
    ]
    return fitted, streams, blocks.order


def _pack_network(state: TextureState) -> bytes:
    tensors = [state.tensors[name] for name in state.spec.tensors]
    steps = np.array([tensor.step for tensor in tensors], "<f2")
    for name, tensor, step in zip(state.spec.tensors, tensors, steps, strict=True):
        if float(step) != tensor.step or not np.isfinite(step):
            raise InputError(f"{name}: step {tensor.step!r} is no finite float16 number; round it to one")
    return steps.tobytes() + numbers.pack([tensor.integers for tensor in tensors])


def _unpack_network(reader: Reader, spec: TextureSpec) -> dict[str, Tensor]:
    steps = np.frombuffer(reader.bytes(2 * len(spec.tensors)), "<f2")
    reader.require(bool(np.isfinite(steps).all()), "steps that are not finite")
    arrays = numbers.unpack(reader, list(spec.tensors.values()))
    return {name: Tensor(array, float(step)) for name, array, step in zip(spec.tensors, arrays, steps, strict=True)}

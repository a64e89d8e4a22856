"""What commands say of neural textures."""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from warp_neural.kernels.texture.spec import BlockSpec
from warp_neural.nn.state import NetworkState
from warp_neural.texture.block_state import BlockState
from warp_neural.texture.file import MAGIC, TextureFile
from warp_neural.texture.state import Map, TextureState


def is_texture(path: Path) -> bool:
    """By its name or its content."""
    with suppress(OSError), path.open("rb") as file:
        return path.suffix.lower() == ".wntc" or file.read(len(MAGIC)) == MAGIC
    return path.suffix.lower() == ".wntc"


def describe_file(path: Path) -> dict:
    """Without decoding any latents."""
    file = TextureFile(path)
    return {"format": "wntc", **describe_texture(file, file.sizes, file.extra)}


def describe_engine(path: Path, network: NetworkState) -> dict:
    """Of a network that has a texture."""
    from warp_neural.texture.engine_file import engine_state  # reads much that other commands do without

    state = engine_state(path, network)
    latents = [path.with_name(each["file"]).stat().st_size for each in network.extra["texture"]["latents"]]
    parts = {"network": path.stat().st_size, "latents": latents}
    return {
        "format": "engine",
        **describe_texture(state, parts | {"all": parts["network"] + sum(latents)}, state.extra),
    }


def describe_texture(state: TextureFile | TextureState | BlockState, parts: dict[str, Any], metrics: Mapping) -> dict:
    """Of a neural texture in a file: parts, its bytes by part; metrics, what was measured when it was made."""
    spec, texels = state.spec, state.spec.height * state.spec.width
    total = parts["all"]
    bits = {name: 8 * int(np.sum(count)) / texels for name, count in parts.items()}
    return {
        "width": spec.width,
        "height": spec.height,
        "mips": spec.mips,
        "bytes": total,
        "bits_per_texel": 8 * total / texels,
        "bits_per_texel_of": bits,
        **({"scales": spec.scales} if isinstance(spec, BlockSpec) else {"grids": [vars(grid) for grid in spec.grids]}),
        "hidden": list(spec.hidden),
        "maps": [_describe_map(each) for each in state.maps],
        "metrics": dict(metrics),
    }


def _describe_map(each: Map) -> dict:
    constant = [each.low[c] for c in range(each.channels) if c not in each.trained]
    spread = [np.float32(ends).item() for ends in (min(each.low), max(each.high))]
    row = {"map": each.name, "kind": each.kind, "channels": each.channels, "constant": constant, "range": spread}
    return row | {"bits": each.bits, "file": each.file or "none"}

"""Neural textures from files, whatever storage they are for."""

from pathlib import Path

import warp as wp

from warp_neural.errors import find_device
from warp_neural.texture.block_state import BlockState
from warp_neural.texture.engine import EngineTexture
from warp_neural.texture.engine_file import SUFFIX, load_engine
from warp_neural.texture.file import load_state
from warp_neural.texture.state import TextureState
from warp_neural.texture.texture import Texture


def load(path: Path | str, device: wp.DeviceLike = None) -> Texture:
    """A .wntc file, or the .safetensors of a texture for engines, whose latents lie beside it. Raises `InputError` for
    one that is damaged."""
    device = find_device(device)
    engine = Path(path).suffix.lower() == SUFFIX
    return make_texture(load_engine(path) if engine else load_state(path, device), device)


def make_texture(state: TextureState | BlockState, device: wp.DeviceLike = None) -> Texture:
    return (EngineTexture if isinstance(state, BlockState) else Texture)(state, device)

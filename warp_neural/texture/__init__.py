"""`wn.texture`: textures of a material compressed into latents and one tiny network."""

from warp_neural.kernels.texture import filters
from warp_neural.texture.compression import compress
from warp_neural.texture.engine import EngineTexture
from warp_neural.texture.files import load
from warp_neural.texture.loaded import BlockMaps, CodedMaps
from warp_neural.texture.texture import Texture
from warp_neural.texture.virtual import VirtualTexture

__all__ = ["BlockMaps", "CodedMaps", "EngineTexture", "Texture", "VirtualTexture", "compress", "filters", "load"]

"""`wn.texture`: textures of a material compressed into latents and one tiny network."""

from warp_neural.kernels.texture import filters
from warp_neural.texture.compression import compress
from warp_neural.texture.texture import Texture, load

__all__ = ["Texture", "compress", "filters", "load"]

"""What a neural material is made of: the sizes of its networks, and what they read."""

from dataclasses import dataclass

import warp as wp

from warp_neural.kernels.errors import require, require_whole
from warp_neural.kernels.nn import activations
from warp_neural.kernels.nn.spec import FLOAT32, NetworkSpec, format_of

LATENTS = 8
vec_latents = wp.types.vector(LATENTS, float)

DIRECTIONS = ("light_view", "half_difference")
SAMPLER_OUTPUTS = 10  # mean direction 3, widths 3, share of the diffuse lobe 1, albedo 3


@dataclass(frozen=True)
class NeuralSpec:
    """The decoder: `depth` hidden layers of `width`, as the dial's 2x16, 2x32 and 3x64, of `precision`.

    frames: 2 learned shading frames, in whose coordinates it reads light and view, or 0 for the surface's own.
    directions: as what it reads them in each frame, light and view themselves, or half and difference vector, which
    left less error in every trial: a highlight lies about half vectors, wherever light and view are.
    """

    depth: int = 2
    width: int = 32
    frames: int = 2
    precision: str = "float16"
    directions: str = "half_difference"

    def __post_init__(self) -> None:
        require_whole("depth", self.depth, 1, 8)
        require_whole("width", self.width, 1, 256)
        require(self.frames in (0, 2), "frames", self.frames, "0 or 2")
        require(self.precision in ("float16", "float32"), "precision", self.precision, "float16 or float32")
        require(self.directions in DIRECTIONS, "directions", self.directions, f"one of {', '.join(DIRECTIONS)}")

    @property
    def decoder(self) -> NetworkSpec:
        """Latents and 6 numbers for each frame to RGB: exp keeps it positive, and its logarithm, which the loss looks
        at, near linear; exp(-3) is about an albedo of 0.16 over pi, where training begins."""
        sizes = (LATENTS + 6 * max(self.frames, 1), *[self.width] * self.depth, 3)
        return NetworkSpec(sizes, activations.leaky_relu, activations.shifted_exponential, format_of(self.precision))

    @property
    def frame_layer(self) -> NetworkSpec:
        """Latents to normal and tangent of two frames, one linear layer; never rounded, as highlights are narrow."""
        return NetworkSpec((LATENTS, 12), activations.linear, activations.linear, FLOAT32)

    @property
    def sampler(self) -> NetworkSpec:
        """Latents and view to a lobe and the albedo: 3x32."""
        sizes = (LATENTS + 3, 32, 32, 32, SAMPLER_OUTPUTS)
        return NetworkSpec(sizes, activations.leaky_relu, activations.linear, format_of(self.precision))

    @property
    def networks(self) -> dict[str, NetworkSpec]:
        """By their names in files."""
        return {"decoder": self.decoder, "frames": self.frame_layer, "sampler": self.sampler}

    def __str__(self) -> str:
        return f"{self.depth}x{self.width}, {self.frames} frames, {self.precision}"

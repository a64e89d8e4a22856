"""What a neural material is, on the host: networks, latents and what it was made of."""

from dataclasses import dataclass, field

import numpy as np

from warp_neural.errors import InputError
from warp_neural.kernels.materials.neural_spec import LATENTS, NeuralSpec
from warp_neural.nn.state import NetworkState

Levels = tuple[np.ndarray, ...]
"""Latents of each mip level, [height, width, LATENTS], the finest first."""


@dataclass(frozen=True)
class NeuralState:
    """networks: by their names in `spec.networks`. codes: uint8 levels; a latent is scale[0] + code scale[1]. scale:
    float32 [LATENTS, 2]. source: the name of what was baked. metrics: what was measured, plain JSON values."""

    spec: NeuralSpec
    networks: dict[str, NetworkState]
    codes: Levels
    scale: np.ndarray
    source: str = ""
    metrics: dict = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, spec in self.spec.networks.items():
            found = self.networks.get(name)
            if found is None or found.spec != spec or found.count != 1:
                raise InputError(
                    f"neural material {self.source}: {name} is not the one network of a {self.spec} decoder"
                )
        for level in self.codes:
            if level.dtype != np.uint8 or level.ndim != 3 or level.shape[2] != LATENTS or not level.size:
                raise InputError(f"neural material {self.source}: latents are {level.dtype} {level.shape}")

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the finest level."""
        return self.codes[0].shape[:2]


def quantized(levels: list[np.ndarray]) -> tuple[Levels, np.ndarray]:
    """Codes of 8 bits and their scale, of float levels: over each latent's range, all levels together."""
    flat = np.concatenate([level.reshape(-1, LATENTS) for level in levels])
    low, high = flat.min(axis=0), flat.max(axis=0)
    step = np.maximum((high - low) / 255, 1e-12)
    codes = tuple(np.clip(np.rint((level - low) / step), 0, 255).astype(np.uint8) for level in levels)
    return codes, np.stack([low, step], axis=-1).astype(np.float32)

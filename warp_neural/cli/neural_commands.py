"""`warp-neural bake`: from a layered material to a neural one, and what `info` says of its file."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from warp_neural.cli.options import Between, Options, Seed, resolve_device
from warp_neural.errors import InputError
from warp_neural.io.files import check_target

if TYPE_CHECKING:
    from warp_neural.materials.layered import LayeredMaterial
    from warp_neural.materials.neural_state import NeuralState

SUFFIX = ".wnm"


@dataclass(frozen=True, kw_only=True)
class Bake(Options):
    """Bake a layered material into a neural one: latents and small networks, in one file for renderers.

    Early: in the small form of a CPU highlights are too wide yet, and grazing views too bright.
    """

    source: tyro.conf.Positional[str]
    """folder of maps, a MaterialX document (.mtlx), or deluxe, the built-in one with everything"""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """file to write, .wnm"""
    decoder: Literal["2x16", "2x32", "3x64"] = "2x32"
    """hidden layers and their width: cost against likeness"""
    frames: Literal[0, 2] = 2
    """learned shading frames, in which the decoder sees light and view"""
    precision: Literal["float16", "float32"] = "float16"
    """of the decoder and the sampler"""
    side: Annotated[int | None, Between(1, 4096)] = None
    """texels of the latents' sides; none: 128 on the CPU, 1024 on CUDA"""
    steps: Annotated[int | None, Between(8, 10_000_000)] = None
    """of the decoder's training; none: 3000 on the CPU, 8000 on CUDA, a tenth with --preview"""
    preview: bool = False
    """a fast, rougher result"""
    device: str = "auto"
    """auto (CUDA when present), cpu, cuda or cuda:N"""
    seed: Seed = 0
    """of every random draw; the same seed gives the same file on the CPU"""
    json: bool = False
    """print nothing but one JSON object, as the last line on stdout"""

    def main(self) -> dict:
        from dataclasses import replace

        from warp_neural.kernels.materials.neural_spec import NeuralSpec
        from warp_neural.materials.bake import bake, effort_of

        device = resolve_device(self.device)
        if self.out.suffix != SUFFIX:
            raise InputError(f"{self.out}: name it {SUFFIX}")
        check_target(self.out)
        effort = effort_of(device, self.side, self.preview)
        effort = replace(effort, steps=self.steps) if self.steps else effort
        spec = NeuralSpec(*map(int, self.decoder.split("x")), self.frames, self.precision)
        material = bake(
            read_source(self.source, effort.side), spec, effort=effort, seed=self.seed, device=device, quiet=self.json
        )
        material.save(self.out)
        return {"written": str(self.out), **describe_neural(self.out, material.states[0])}


def read_source(source: str, side: int) -> "LayeredMaterial":
    """side: of the maps of `deluxe`."""
    from warp_neural.materials.deluxe import deluxe_material
    from warp_neural.materials.layered import from_material
    from warp_neural.materials.material import load_material
    from warp_neural.materials.materialx import load_materialx

    if source == "deluxe":
        return deluxe_material(max(side, 4))
    if source.lower().endswith(".mtlx"):
        return load_materialx(source)
    return from_material(load_material(source))


def describe_neural(path: Path, state: "NeuralState") -> dict:
    height, width = state.size
    networks = {name: list(network.spec.sizes) for name, network in state.networks.items()}
    return {
        "format": "neural_material",
        "source": state.source,
        "width": width,
        "height": height,
        "mips": len(state.codes),
        "decoder": str(state.spec),
        "networks": networks,
        "parameters": sum(network.parameters.size for network in state.networks.values()),
        "bytes": path.stat().st_size,
        "metrics": dict(state.metrics),
    }

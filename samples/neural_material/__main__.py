"""The main job: a layered material becomes a latent texture and a small network, in the lecture's three iterations.

    python -m samples.neural_material [--material FOLDER] [--side 64]

After Zeltner et al. 2024, "Real-Time Neural Appearance Models": glazed bricks with dust and fingerprints, twelve maps
and four lobes, are learned by a decoder that reads eight latents and the directions. Leaves iterations.png, a patch
under a point light, and the material as material.wnm.

- naive: the latents of each texel are trained with the network, from nothing. Each texel sees few samples, its own.
- encoder: a network makes latents of the material's parameters. What one texel teaches serves all that are like it.
  Then it is thrown away: its latents are baked into a texture and tuned a little.
- frames: a linear layer takes two shading frames from the latents, in which the decoder sees light and view. It has no
  rotations to learn.

All three have the same decoder, 2x32, and see the same number of samples; then 2x16 and 3x64 with frames. Errors are
means of |log(1 + prediction) - log(1 + reference)| of BRDF times cosine, over held-out places and directions, half of
the lights where highlights are. On two CPU cores, 64 x 64 latents, two million samples a
training, one minute in all:

    naive     0.165      2x16   0.185
    encoder   0.157      2x32   0.152
    frames    0.152      3x64   0.130

That is one seed. All three make the brass's highlights too wide, and in the displayed picture naive is nearest to the
reference (mean difference 0.081, 0.088, 0.091): at this size each texel sees some 400 pairs of its own.
"""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from warp_neural import cli
from warp_neural.cli import Between, CommonConfig, Count
from warp_neural.cli.neural_commands import read_source
from warp_neural.io.files import atomic_path
from warp_neural.kernels.materials.neural_spec import NeuralSpec
from warp_neural.materials.bake import Effort, bake
from warp_neural.materials.layered import LayeredMaterial, LayeredSet
from warp_neural.materials.neural import NeuralMaterial
from warp_neural.samples.neural_material.figures import save_sheet
from warp_neural.samples.neural_material.patch import patch

ITERATIONS = {
    "naive": (NeuralSpec(frames=0), "texture"),
    "encoder": (NeuralSpec(frames=0), "encoder"),
    "frames": (NeuralSpec(frames=2), "encoder"),
}
DIAL = {"2x16": NeuralSpec(2, 16), "2x32": NeuralSpec(2, 32), "3x64": NeuralSpec(3, 64)}


@dataclass(frozen=True, kw_only=True)
class Config(CommonConfig):
    """Options of the section."""

    out: Path = Path("out/neural_material")
    """folder for pictures and files"""
    material: str = "deluxe"
    """folder with maps, a MaterialX document, or the built-in material with everything"""
    side: Annotated[int | None, Between(4, 4096)] = None
    """texels of the latents' sides; none: 64 on the CPU, 1024 on CUDA"""
    steps: Count | None = None
    """of each training; none: 2000 on the CPU, 8000 on CUDA"""

    @property
    def effort(self) -> Effort:
        cuda = cli.resolve_device(self.device).is_cuda
        steps = self.steps or (8000 if cuda else 2000)
        return Effort(self.side or (1024 if cuda else 64), steps, steps // 4, 8192 if cuda else 128)


def train(config: Config, material: LayeredMaterial, spec: NeuralSpec, way: str) -> NeuralMaterial:
    device = cli.resolve_device(config.device)
    return bake(material, spec, way=way, effort=config.effort, seed=config.seed, device=device, quiet=config.json)


def main(config: Config) -> dict:
    began = time.perf_counter()
    with atomic_path(config.out / "iterations.png") as path:  # a folder that cannot be written fails now
        path.touch()
    material = read_source(config.material, config.effort.side)
    trained = {name: train(config, material, *each) for name, each in ITERATIONS.items()}
    dial = {
        name: trained["frames"] if spec == trained["frames"].spec else train(config, material, spec, "encoder")
        for name, spec in DIAL.items()
    }
    trained["frames"].save(config.out / "material.wnm")
    metrics = {}
    for name, each in {**trained, **dial}.items():
        found = each.states[0].metrics
        metrics |= {f"error_{name}": found["error"], f"seconds_{name}": found["seconds"]}
    reference = LayeredSet(material, device=cli.resolve_device(config.device))
    pictures = {name: patch(each) for name, each in trained.items()}
    pictures["reference"] = patch(reference, config.effort.side)
    save_sheet(config.out / "iterations.png", pictures, metrics)
    return metrics | {"seconds_total": time.perf_counter() - began}


if __name__ == "__main__":
    cli.run(main, Config)

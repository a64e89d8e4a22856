"""`warp-neural render`: a picture of a material on a knob, a sphere or any mesh."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from warp_neural.cli.options import Between, Options, Positive, Seed, resolve_device
from warp_neural.cli.quantities import sides_of
from warp_neural.errors import InputError
from warp_neural.io.files import check_target

FLOOR = 0.35, 0.35, 0.36
DEFAULT, DELUXE = "default", "deluxe"


@dataclass(frozen=True, kw_only=True)
class Render(Options):
    """Render a material in an environment by path tracing, and say how many samples there were."""

    material: tyro.conf.Positional[Path]
    """folder of maps, document of MaterialX (.mtlx), default or deluxe"""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """picture to write: .png, .jpg, .tif (after the film curve) or .exr, .hdr (linear radiance)"""
    scene: str = "knob"
    """knob, sphere, or a file of a mesh: .glb, .gltf, .obj, .ply"""
    light: Path | None = None
    """environment, .exr or .hdr, equirectangular; a studio if not given"""
    rotation: Annotated[float, Between(-360, 360)] = 0.0
    """degrees by which the environment is turned to the right"""
    exposure: Annotated[float, Between(-20, 20)] = 0.0
    """stops"""
    repeat: Positive = 3.0
    """times that the material goes around the knob or the sphere"""
    size: str = "900x600"
    """width and height"""
    samples: Annotated[int, Between(1, 10**6)] = 64
    """paths a pixel"""
    time: Positive | None = None
    """seconds after which no more samples begin"""
    features: bool = False
    """write albedo.exr and normal.exr beside the picture"""
    device: str = "auto"
    """auto (CUDA when present), cpu, cuda or cuda:N"""
    seed: Seed = 0
    """of every random draw; the same seed and number of samples give the same picture on one device"""
    json: bool = False
    """print nothing but one JSON object, as the last line on stdout"""

    def main(self) -> dict:
        from warp_neural import render  # reads much that the other commands do without

        device, size = resolve_device(self.device), sides_of("--size", self.size)
        if size == "largest":
            raise InputError("--size largest: give width and height, as in 900x600")
        check_target(self.out)
        light = {"rotation": self.rotation}
        environment = render.Environment.load(self.light, **light) if self.light else render.Environment.studio(**light)
        scene, camera = self._scene()
        materials = render.combine(self._material(device), render.Diffuse([FLOOR], device=device))
        options = {"samples": self.samples, "seconds": self.time, "seed": self.seed, "quiet": self.json}
        picture = render.render(scene, materials, environment, camera, size, **options, device=device)
        picture.save(self.out, exposure=self.exposure)
        if self.features:
            picture.save_features(self.out.parent)
        pixels = size[0] * size[1] * picture.samples
        return {
            "written": str(self.out),
            "samples": picture.samples,
            "seconds": picture.seconds,
            "seconds_per_megasample": 1e6 * picture.seconds / pixels,
            "dropped": picture.dropped,
        }

    def _material(self, device: Any) -> Any:
        """A set of one."""
        from warp_neural.materials.default_material import default_material
        from warp_neural.materials.deluxe import deluxe_material
        from warp_neural.materials.layered import LayeredSet
        from warp_neural.materials.material import load_material
        from warp_neural.materials.materialx import load_materialx
        from warp_neural.render import Textured

        if str(self.material) == DELUXE:
            return LayeredSet(deluxe_material(), device=device)
        if self.material.suffix == ".mtlx":
            return LayeredSet(load_materialx(self.material), device=device)
        maps = default_material() if str(self.material) == DEFAULT else load_material(self.material)
        return Textured(maps, device=device)

    def _scene(self) -> tuple[Any, Any]:
        """What is to be seen stands on a floor, about as large as the knob."""
        import numpy as np

        from warp_neural import render

        shapes = {"knob": render.knob, "sphere": render.sphere}
        if self.scene in shapes:
            mesh = shapes[self.scene](repeat=self.repeat)
        elif Path(self.scene).suffix:
            mesh = render.load_mesh(self.scene, material=0)
        else:
            raise InputError(f"--scene {self.scene}: give knob, sphere or the file of a mesh")
        low, high = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
        scale = 2.5 / max(float((high - low).max()), 1e-30)
        foot = np.array([low[0] + high[0], 2 * low[1], low[2] + high[2]]) / 2
        middle = scale * float(high[1] - low[1]) / 2
        mesh = mesh.moved(tuple(-scale * foot), scale=scale)
        camera = render.Camera(eye=(0.0, middle + 1.2, 6.2), target=(0.0, middle - 0.1, 0.0))
        return render.Scene([mesh, render.floor(60.0, material=1)]), camera

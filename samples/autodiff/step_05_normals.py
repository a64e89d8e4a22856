"""autodiff 5: the normals of a distance field by forward mode. Leaves normals.png.

    python -m samples.autodiff.step_05_normals

A normal is the gradient of the distance: three directions of forward mode. Central differences need six evaluations and
a step that is neither too large (the field bends) nor too small (digits cancel). Judged against forward mode in float64
at the same points, which agrees with central differences in float64. Expect a mean error of about 0.00001 degrees for
forward mode, and of 0.02 degrees for differences of the best step.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import warp as wp

from warp_neural import cli
from warp_neural.samples.autodiff.figures import save_sheet
from warp_neural.samples.autodiff.scene import DOUBLE, SINGLE

STEPS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)
LIGHT = wp.constant(wp.vec3(-0.48, 0.64, 0.6))
EYE = wp.constant(wp.vec3(0.0, 0.9, 4.3))
FAR = 12.0

distance, normal, normal_by_differences = SINGLE
normal_double, normal_double_by_differences = DOUBLE.normal, DOUBLE.normal_by_differences


@dataclass(frozen=True, kw_only=True)
class Config(cli.CommonConfig):
    out: Path = Path("out/autodiff")
    """folder for the picture"""
    size: Annotated[int, cli.Between(8, 4096)] = 512
    """height of the picture; it is 16:9"""


@wp.func
def march(origin: wp.vec3, direction: wp.vec3) -> float:
    """Distance along the ray to the surface, FAR if it misses (Hart 1996, "Sphere Tracing")."""
    t = float(0.02)
    for _ in range(160):
        d = distance(origin + t * direction)
        t += 0.8 * d
        if d < 2e-4 * t or t > FAR:
            break
    return wp.min(t, FAR)


@wp.kernel(enable_backward=False)
def trace_kernel(points: wp.array2d[wp.vec3], hits: wp.array2d[bool]):
    i, j = wp.tid()
    height, width = float(points.shape[0]), float(points.shape[1])
    x, y = (float(j) + 0.5 - 0.5 * width) / height, (0.5 * height - float(i) - 0.5) / height
    direction = wp.normalize(wp.vec3(1.1 * x, 1.1 * y - 0.22, -1.0))
    t = march(EYE, direction)
    points[i, j] = EYE + t * direction
    hits[i, j] = t < FAR


@wp.kernel(enable_backward=False)
def normal_kernel(points: wp.array2d[wp.vec3], normals: wp.array2d[wp.vec3]):
    i, j = wp.tid()
    normals[i, j] = normal(points[i, j])


@wp.kernel(enable_backward=False)
def difference_kernel(points: wp.array2d[wp.vec3], h: float, normals: wp.array2d[wp.vec3]):
    i, j = wp.tid()
    normals[i, j] = normal_by_differences(points[i, j], h)


@wp.kernel(enable_backward=False)
def double_kernel(points: wp.array2d[wp.vec3], normals: wp.array2d[wp.vec3d], differences: wp.array2d[wp.vec3d]):
    i, j = wp.tid()
    p = wp.vec3d(points[i, j])
    normals[i, j] = normal_double(p)
    differences[i, j] = normal_double_by_differences(p, wp.float64(1e-6))


@wp.kernel(enable_backward=False)
def shade_kernel(points: wp.array2d[wp.vec3], normals: wp.array2d[wp.vec3], colors: wp.array2d[wp.vec3]):
    i, j = wp.tid()
    p, n = points[i, j], normals[i, j]
    occlusion = float(1.0)
    for k in range(1, 6):
        step = 0.08 * float(k)
        occlusion -= (step - distance(p + step * n)) * 0.9 / float(k)
    lit = wp.where(march(p + 0.01 * n, LIGHT) < FAR, 0.0, wp.max(wp.dot(n, LIGHT), 0.0))
    glossy = wp.pow(wp.max(wp.dot(n, wp.normalize(LIGHT + wp.normalize(EYE - p))), 0.0), 60.0)
    warm = wp.smoothstep(-0.88, -0.7, p[1])
    albedo = wp.lerp(wp.vec3(0.2, 0.23, 0.28), wp.vec3(0.75, 0.27, 0.08), warm)
    sky = wp.lerp(wp.vec3(0.1, 0.09, 0.08), wp.vec3(0.4, 0.5, 0.65), 0.5 + 0.5 * n[1])
    color = wp.cw_mul(albedo, sky * wp.clamp(occlusion, 0.0, 1.0) + wp.vec3(1.6, 1.45, 1.25) * lit)
    fog = wp.exp(-wp.pow(wp.length(p - EYE) / 9.0, 6.0))
    colors[i, j] = wp.lerp(wp.vec3(0.55, 0.65, 0.8), color + wp.vec3(0.5 * glossy * lit), fog)


def degrees(normals: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Angles between unit vectors `[..., 3]`, exact for small ones too."""
    return np.degrees(2 * np.arcsin(np.clip(np.linalg.norm(normals - truth, axis=-1) / 2, 0, 1)))


def main(config: Config) -> dict:
    device = cli.resolve_device(config.device)
    shape = (config.size, config.size * 16 // 9)
    hits = wp.empty(shape, dtype=bool, device=device)
    points, normals, differences, colors = (wp.empty(shape, dtype=wp.vec3, device=device) for _ in range(4))
    truth, double_differences = (wp.empty(shape, dtype=wp.vec3d, device=device) for _ in range(2))

    def launch(kernel, inputs, outputs):
        wp.launch(kernel, shape, inputs=inputs, outputs=outputs, device=device)

    launch(trace_kernel, [], [points, hits])
    launch(normal_kernel, [points], [normals])
    launch(double_kernel, [points], [truth, double_differences])
    launch(shade_kernel, [points, normals], [colors])
    hit, truth = hits.numpy(), truth.numpy()
    solid = hit & (points.numpy()[..., 1] > -0.85)  # on the flat floor every normal is right
    errors = {"forward": degrees(normals.numpy(), truth)}
    for h in STEPS:
        launch(difference_kernel, [points, h], [differences])
        errors[f"h_{h:g}"] = degrees(differences.numpy(), truth)
    save_sheet(config.out / "normals.png", colors.numpy(), normals.numpy(), hit, solid, errors)
    metrics = {f"normal_degrees_{name}": float(error[solid].mean()) for name, error in errors.items()}
    metrics["normal_degrees_float64"] = float(np.median(degrees(double_differences.numpy(), truth)[solid]))
    print("normal = ∇d / |∇d|, by fwd_diff(d)(diffPair(p, e_k)) for k = x, y, z; mean error in degrees:")
    for name, error in metrics.items():
        print(f"  {name:28} {error:.3g}")
    best = min(metrics[f"normal_degrees_h_{h:g}"] for h in STEPS)
    if metrics["normal_degrees_forward"] >= best:
        raise ArithmeticError("normals by forward mode are no better than those by central differences")
    return metrics


if __name__ == "__main__":
    cli.run(main, Config)

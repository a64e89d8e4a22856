"""mipmap 5: learn the small maps by gradient descent through the shader. Leaves step_05.png.

    python -m samples.mipmap.step_05_train

The course's recipe: from grey, one random light and view a texel and step, squared error, Adam. Reads of the learned
maps write their gradient to a buffer; the reference has an empty adjoint, so nothing flows into it. Expect the loss
under step 1's light to end at 0.12, from 0.84 with filtered maps: better there, though not yet from everywhere
(`python -m samples.mipmap` says what is missing).
"""

from dataclasses import dataclass

import numpy as np
import warp as wp

import warp_neural as wn
from warp_neural import cli
from warp_neural.materials.shading import brdf, read_float, read_vec3, uniform_hemisphere
from warp_neural.samples.figures import save_picture
from warp_neural.samples.mipmap.maps import MaterialConfig, source_maps
from warp_neural.samples.mipmap.step_01_basic_program import render, shown, upload
from warp_neural.samples.mipmap.step_02_downsampled_inputs import downsampled, enlarge
from warp_neural.train.optim import Adam, Parameters, linear


@dataclass(frozen=True, kw_only=True)
class Config(MaterialConfig):
    steps: cli.Count = 1500
    """gradient steps"""
    rate: cli.Positive = 0.002
    """Adam's learning rate, falling to a tenth on a line"""


@wp.func
def reference_mean(
    albedo: wp.array2d[wp.vec3],
    normal: wp.array2d[wp.vec3],
    roughness: wp.array2d[float],
    metalness: wp.array2d[float],
    factor: int,
    i: int,
    j: int,
    light: wp.vec3,
    view: wp.vec3,
) -> wp.vec3:
    """Step 3 for one texel: the mean of factor x factor shaded source texels."""
    color = wp.vec3(0.0)
    for k in range(factor * factor):
        y = i * factor + k // factor
        x = j * factor + k % factor
        color += brdf(albedo[y, x], normal[y, x], roughness[y, x], metalness[y, x], 1.0, light, view)
    return color / float(factor * factor)


@wp.func_grad(reference_mean)
def adj_reference_mean(
    albedo: wp.array2d[wp.vec3],
    normal: wp.array2d[wp.vec3],
    roughness: wp.array2d[float],
    metalness: wp.array2d[float],
    factor: int,
    i: int,
    j: int,
    light: wp.vec3,
    view: wp.vec3,
    adj_color: wp.vec3,
):
    pass  # the source does not learn


@wp.kernel
def loss_kernel(
    source_albedo: wp.array2d[wp.vec3],
    source_normal: wp.array2d[wp.vec3],
    source_roughness: wp.array2d[float],
    source_metalness: wp.array2d[float],
    factor: int,
    seed: wp.uint64,
    steps: wp.array[int],
    albedo: wp.array2d[wp.vec3],
    normal: wp.array2d[wp.vec3],
    roughness: wp.array2d[float],
    metalness: wp.array2d[float],
    albedo_gradient: wp.array2d[wp.vec3],
    normal_gradient: wp.array2d[wp.vec3],
    roughness_gradient: wp.array2d[float],
    loss: wp.array2d[float],
):
    i, j = wp.tid()
    u = wn.random.uniform(wn.random.stream(seed, steps[0], i * loss.shape[1] + j), 0)
    light, view = uniform_hemisphere(u[0], u[1]), uniform_hemisphere(u[2], u[3])

    a = read_vec3(albedo, albedo_gradient, i, j)
    n = wp.normalize(read_vec3(normal, normal_gradient, i, j))
    r = read_float(roughness, roughness_gradient, i, j)
    color = brdf(a, n, r, metalness[i, j], 1.0, light, view)
    reference = reference_mean(
        source_albedo, source_normal, source_roughness, source_metalness, factor, i, j, light, view
    )
    error = color - reference
    loss[i, j] = wp.dot(error, error)


@wp.kernel(enable_backward=False)
def project_kernel(albedo: wp.array2d[wp.vec3], normal: wp.array2d[wp.vec3], roughness: wp.array2d[float]):
    """Back to what a texture can hold."""
    i, j = wp.tid()
    a = albedo[i, j]
    albedo[i, j] = wp.vec3(wp.clamp(a[0], 0.0, 1.0), wp.clamp(a[1], 0.0, 1.0), wp.clamp(a[2], 0.0, 1.0))
    normal[i, j] = wp.normalize(normal[i, j])
    roughness[i, j] = wp.clamp(roughness[i, j], 0.0, 1.0)


def main(config: Config) -> dict:
    device = cli.resolve_device(config.device)
    _name, maps = source_maps(config, device)
    source = upload(maps, device)
    filtered = [downsampled(texture, config.factor) for texture in source]
    shape = filtered[0].shape

    grey = wp.full(shape, value=wp.vec3(0.5), dtype=wp.vec3, device=device)
    up = wp.full(shape, value=wp.vec3(0.0, 0.0, 1.0), dtype=wp.vec3, device=device)
    half = wp.full(shape, value=0.5, dtype=float, device=device)
    parameters = Parameters(albedo=grey, normal=up, roughness=half)
    learned = [parameters[name] for name in ("albedo", "normal", "roughness")]
    gradients = [texture.grad for texture in learned]
    optimizer = Adam(parameters, lr=linear(config.rate, 0.1 * config.rate, config.steps))

    loss = wp.empty(shape, dtype=float, device=device)
    one = wp.full(shape, value=1.0, dtype=float, device=device)  # d loss / d loss
    metalness = filtered[3]
    inputs = [*source, config.factor, config.seed, optimizer.steps, *learned, metalness, *gradients]
    for _ in cli.progress(range(config.steps), config):
        # The adjoint kernel runs the forward part itself: one launch does both.
        wp.launch(
            loss_kernel, dim=shape, inputs=inputs, outputs=[loss], adjoint=True,
            adj_inputs=[None] * len(inputs), adj_outputs=[one], device=device,
        )  # fmt: skip
        optimizer.step()
        wp.launch(project_kernel, dim=shape, inputs=learned, device=device)

    reference = downsampled(render(source), config.factor)
    answers = [render(filtered), render([*learned, metalness])]
    row = [enlarge(shown(picture), config.factor) for picture in (reference, *answers)]
    save_picture(config.out / "step_05.png", np.concatenate(row, axis=1))
    losses = [float(np.square(picture.numpy() - reference.numpy()).sum(axis=-1).mean()) for picture in answers]
    return {"loss_filtered": losses[0], "loss_learned": losses[1], "resolution": list(shape)}


if __name__ == "__main__":
    cli.run(main, Config)

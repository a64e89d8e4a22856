"""The loss of one texel, its gradient, and the loop that learns maps by following it."""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import warp as wp

import warp_neural as wn
from warp_neural.materials.shading import (
    brdf,
    display_smooth,
    lobe_density,
    lobe_light,
    lobe_view,
    uniform_hemisphere,
)
from warp_neural.samples.mipmap.maps import Maps, load_channels, packed_normal, packed_shade
from warp_neural.train.optim import Parameters, cosine

wp.set_module_options({"fast_math": True})  # CUDA: divisions and roots good to 2 ulp; the judge has exact ones
MIN_ROUGHNESS = wp.constant(0.032)  # the shader's own floor


@wp.func
def texel_loss(
    albedo: wp.vec3,
    normal: wp.vec3,
    roughness: float,
    metalness: float,
    specular: float,
    light: wp.vec3,
    view: wp.vec3,
    reference: wp.vec3,
    weights: wp.vec2,
) -> wp.float32:  # not `float`: Warp 1.19 then writes wp.grad's seed as C++ that does not compile
    """weights[0] times the squared error of radiance plus weights[1] times that of displayed values, mean of RGB."""
    color = brdf(albedo, wp.normalize(normal), roughness, metalness, specular, light, view)
    error = color - reference
    shown = display_smooth(color) - display_smooth(reference)
    return (weights[0] * wp.dot(error, error) + weights[1] * wp.dot(shown, shown)) / 3.0


@wp.kernel
def keep_adjoints_kernel(v: wp.array[wp.vec3], x: wp.array[float], loss: wp.array[float]):
    """Never launched. Warp 1.19 gives `wp.grad` an EMPTY adjoint, silently, for a nested function that forward code
    reached first (here `ggx` through `lobe_density`), unless a kernel with a backward pass needs it too."""
    loss[0] = texel_loss(v[0], v[1], x[0], x[1], x[2], v[2], v[3], v[4], wp.vec2(x[3], x[4]))


@wp.kernel(enable_backward=False)
def gradient_kernel(
    source: wp.array3d[float],  # [texels of the source under a texel, n, 8], see pack
    seed: wp.uint64,
    steps: wp.array[int],  # [1], part of the seed
    pairs: int,
    uniform_share: float,
    weights: wp.vec2,
    albedo: wp.array[wp.vec3],  # this and the maps below [n]
    normal: wp.array[wp.vec3],
    roughness: wp.array[float],
    metalness: wp.array[float],
    specular: wp.array[float],
    albedo_gradient: wp.array[wp.vec3],
    normal_gradient: wp.array[wp.vec3],
    roughness_gradient: wp.array[float],
    metalness_gradient: wp.array[float],
    specular_gradient: wp.array[float],
):
    """The texel's gradient, averaged over `pairs` random pairs of a light and a view direction."""
    t = wp.tid()
    random = wn.random.stream(seed, steps[0], t)
    count = source.shape[0]
    own_normal = wp.normalize(normal[t])
    own_roughness = roughness[t]
    albedo_sum = wp.vec3(0.0)
    normal_sum = wp.vec3(0.0)
    roughness_sum = float(0.0)
    metalness_sum = float(0.0)
    specular_sum = float(0.0)

    for pair in range(pairs):
        # A share of the pairs is uniform; the others follow the highlight of one facet: half the time the learned
        # texel's own, else one of the source's.
        u, w = wn.random.uniform(random, 3 * pair), wn.random.uniform(random, 3 * pair + 1)
        light, view = uniform_hemisphere(u[0], u[1]), uniform_hemisphere(u[2], u[3])
        facet_normal = own_normal
        facet_roughness = own_roughness
        if w[0] < 0.5:
            facet = int(w[1] * float(count))
            channels = load_channels(source[facet], t)
            facet_normal = packed_normal(channels)
            facet_roughness = channels[3]
        if w[2] >= uniform_share:
            u = wn.random.uniform(random, 3 * pair + 2)
            view = lobe_view(facet_normal, facet_roughness, w[3], u[0], u[1])
            light = lobe_light(facet_normal, facet_roughness, view, u[2], u[3])

        if light[2] > 0.0 and view[2] > 0.0 and wp.dot(light, light + view) > 0.0:
            reference = wp.vec3(0.0)
            density = float(0.0)
            for k in range(count):
                channels = load_channels(source[k], t)
                density += lobe_density(packed_normal(channels), channels[3], light, view)
                reference += packed_shade(channels, light, view)
            reference /= float(count)

            # One-sample balance heuristic (Veach and Guibas 1995): unbiased, and no weight exceeds 1 / uniform_share
            own = lobe_density(own_normal, own_roughness, light, view)
            mixture = 0.5 * own + 0.5 * density / float(count)
            weight = 1.0 / ((uniform_share + (1.0 - uniform_share) * mixture) * float(pairs))

            da, dn, dr, dm, ds, _l, _v, _r, _w = wp.grad(texel_loss)(
                albedo[t], normal[t], own_roughness, metalness[t], specular[t], light, view, reference, weights
            )
            albedo_sum += da * weight
            normal_sum += dn * weight
            roughness_sum += dr * weight
            metalness_sum += dm * weight
            specular_sum += ds * weight

    albedo_gradient[t] = albedo_sum
    normal_gradient[t] = normal_sum
    roughness_gradient[t] = roughness_sum
    metalness_gradient[t] = metalness_sum
    specular_gradient[t] = specular_sum


@wp.kernel(enable_backward=False)
def project_kernel(
    albedo: wp.array[wp.vec3],
    normal: wp.array[wp.vec3],
    roughness: wp.array[float],
    metalness: wp.array[float],
    specular: wp.array[float],
):
    """Back to what a texture can hold, as the course does after each step."""
    t = wp.tid()
    a = albedo[t]
    n = normal[t]
    albedo[t] = wp.vec3(wp.clamp(a[0], 0.0, 1.0), wp.clamp(a[1], 0.0, 1.0), wp.clamp(a[2], 0.0, 1.0))
    normal[t] = wp.normalize(wp.vec3(n[0], n[1], wp.max(n[2], 0.01)))
    roughness[t] = wp.clamp(roughness[t], MIN_ROUGHNESS, 1.0)
    metalness[t] = wp.clamp(metalness[t], 0.0, 1.0)
    specular[t] = wp.clamp(specular[t], 0.0, 1.0)


@dataclass(frozen=True)
class Recipe:
    """How to learn: from which maps, along which gradients, and what follows them."""

    optimizer: Callable  # warp_neural.train.optim.Adam or SGD
    rate: float  # at the start; a cosine takes it to 0
    start: Maps
    uniform_share: float  # of the pairs that are uniform on the hemisphere
    weights: tuple[float, float]  # of radiance and displayed error


class Learner:
    """Maps in training."""

    def __init__(self, source: wp.array, recipe: Recipe, *, steps: int, pairs: int, seed: int) -> None:
        self.shape, self.size, self.device = recipe.start.shape, source.shape[1], source.device
        arrays = {name: self._upload(image) for name, image in recipe.start.arrays().items()}
        self.parameters = Parameters(**arrays)
        self.optimizer = recipe.optimizer(self.parameters, lr=cosine(recipe.rate, 0.0, steps))
        maps = [self.parameters[name] for name in arrays]
        gradients = [array.grad for array in maps]
        weights = wp.vec2(*recipe.weights)
        chances = [source, seed, self.optimizer.steps, pairs, recipe.uniform_share, weights]
        self.gradient = self._record(gradient_kernel, [*chances, *maps, *gradients])
        self.project = self._record(project_kernel, maps)
        self.project.launch()

    def step(self) -> None:
        """One gradient step of every texel: four launches, which a CUDA graph may hold."""
        self.gradient.launch()
        self.optimizer.step()
        self.project.launch()

    def maps(self) -> Maps:
        """A copy of the maps as they are now."""
        arrays = self.parameters.numpy()
        return Maps(**{name: array.reshape(*self.shape, *array.shape[1:]) for name, array in arrays.items()})

    def _upload(self, image: np.ndarray) -> wp.array:
        texels = np.ascontiguousarray(image, dtype=np.float32).reshape(self.size, *image.shape[2:])
        return wp.array(texels, dtype=wp.vec3 if image.ndim == 3 else wp.float32, device=self.device)

    def _record(self, kernel: wp.Kernel, inputs: list) -> wp.Launch:
        return wp.launch(kernel, dim=self.size, inputs=inputs, device=self.device, record_cmd=True)


def run(learner: Learner, steps: Iterable[int], *, every: int, watch: Callable[[int], None]) -> float:
    """Take the steps, calling `watch(step)` before each `every`-th; the seconds that the steps alone took."""
    graph = None
    if learner.device.is_cuda:
        wp.load_module("warp_neural.kernels.nn.optimizers", device=learner.device)  # not while a graph is captured
        with wp.ScopedCapture(device=learner.device) as capture:
            learner.step()
        graph = capture.graph
    seconds, began = 0.0, time.perf_counter()
    for step in steps:
        if step % every == 0:
            wp.synchronize_device(learner.device)
            seconds += time.perf_counter() - began
            watch(step)
            began = time.perf_counter()
        if graph is None:
            learner.step()
        else:
            wp.capture_launch(graph)
    wp.synchronize_device(learner.device)
    return seconds + time.perf_counter() - began

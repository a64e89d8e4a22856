"""A training step for every network and device: samples to memory, a differentiable kernel of their losses."""

from functools import cache

import warp as wp

from warp_neural.kernels.kept import kept_by
from warp_neural.kernels.nn.losses import Loss
from warp_neural.kernels.nn.random import stream
from warp_neural.kernels.nn.spec import C_TYPES, NetworkSpec, Parameters
from warp_neural.kernels.training.progress import Progress, batch_of


def data_type(sample: wp.Function) -> type:
    """Of the third argument of `(index, random, data) -> (x, target)`; int where there is none."""
    types = list(sample.input_types.values())
    return types[2] if len(types) == 3 else int


@kept_by("sample")
def make_draw(sample: wp.Function) -> wp.Function:
    """`(progress, step, index, data) -> (x, target)`: one sample of a step, from its own stream of random numbers."""
    data = data_type(sample)

    @wp.func
    def draw(progress: Progress, step: int, index: int, data: data):
        random = stream(progress.seed, step, index)
        if wp.static(len(sample.input_types) == 3):
            x, target = sample(index, random, data)
        else:
            x, target = sample(index, random)
        return x, target

    return draw


@kept_by("sample")
def make_sample_kernel(sample: wp.Function, vec_in: type, n_out: int) -> wp.Kernel:
    """dim (largest batch)."""
    draw, data, vec_out = make_draw(sample), data_type(sample), wp.types.vector(n_out, float)

    @wp.kernel(module="unique", enable_backward=False)
    def sample_kernel(data: data, progress: Progress, micro: int, xs: wp.array[vec_in], targets: wp.array[vec_out]):
        i = wp.tid()
        step = progress.counters[0]
        if i == 0:
            progress.counters[1] = step
        batch = batch_of(progress, step)
        if i < batch:
            x, target = draw(progress, step, micro * batch + i, data)
            xs[i] = x
            targets[i] = target

    return sample_kernel


@cache
def make_convert(n: int, source: type, target: type) -> wp.Function:
    """Between vectors of n float16 and float32; differentiable."""
    vec_in, vec_out = wp.types.vector(n, source), wp.types.vector(n, target)

    @wp.func_native(
        f"wp::vec_t<{n}, {C_TYPES[target]}> y;\n"
        f"for (int i = 0; i < {n}; ++i) y.c[i] = static_cast<{C_TYPES[target]}>(x.c[i]);\nreturn y;\n",
        adj_snippet=f"for (int i = 0; i < {n}; ++i) adj_x.c[i] += static_cast<{C_TYPES[source]}>(adj_ret.c[i]);\n",
    )
    def convert(x: vec_in) -> vec_out: ...

    return convert


@cache
def make_all_finite(n: int) -> wp.Function:
    """Whether all of a vector of n float32 are."""
    vec = wp.types.vector(n, float)

    @wp.func_native(
        f"wp::float32 zero = 0.0f;\nfor (int i = 0; i < {n}; ++i) zero += 0.0f * x.c[i];\nreturn zero == 0.0f;\n"
    )
    def all_finite(x: vec) -> bool: ...

    return all_finite


@cache
def make_loss_kernel(func: wp.Function, spec: NetworkSpec, vec_in: type, loss: Loss) -> wp.Kernel:
    """dim (largest batch): `losses[i]` of sample i, differentiable."""
    n_out = spec.sizes[-1]
    value, vec_out = loss.value(n_out), wp.types.vector(n_out, float)
    to_float = make_convert(n_out, wp.float16, wp.float32)
    is_half = spec.dtype is wp.float16

    @wp.kernel(module="unique", module_options={"enable_mathdx_gemm": False})
    def loss_kernel(
        params: Parameters,
        progress: Progress,
        xs: wp.array[vec_in],
        targets: wp.array[vec_out],
        losses: wp.array[float],
    ):
        i = wp.tid()
        y = func(params, xs[i])
        if i < batch_of(progress, progress.counters[1]):
            if wp.static(is_half):
                losses[i] = value(to_float(y), targets[i])
            else:
                losses[i] = value(y, targets[i])

    return loss_kernel


@wp.kernel(module="unique", enable_backward=False)
def collect_kernel(progress: Progress, batches: int, losses: wp.array[float]):
    """Add up the mean loss; flag the step if a loss is not finite."""
    i = wp.tid()
    step = progress.counters[1]
    batch = batch_of(progress, step)
    if i < batch:
        if not wp.isfinite(losses[i]):
            progress.flags[step % 2] = 1
        wp.atomic_add(progress.losses, step % progress.losses.shape[0], losses[i] / float(batch * batches))

"""Kernels of a user's functions go with these: a program may make trainers for as long as it runs."""

import gc
import weakref

import pytest
import warp as wp

import warp_neural as wn


def make_sample(level):
    @wp.func
    def sample(index: int, random: wn.random.Stream):
        u = wn.random.uniform(random, 0)[0]
        return wp.vec2(u, 0.5), wp.vec3(level * u)

    return sample


def trainer(sample, fused):
    encoding = wn.encodings.LatentTexture(4, 4, 8)
    return wn.Trainer(wn.MLP(2, 3, 16, 1, encoding=encoding, device="cpu"), sample=sample, batch=32, fused=fused)


@pytest.mark.parametrize("fused", [None, False])
def test_functions_and_kernels_of_past_trainers_are_gone(fused):
    functions, kernels, modules = [], [], []
    for level in range(4):
        sample = make_sample(0.1 * level)
        run = trainer(sample, fused)
        run.run(2, quiet=True)
        kernel = run.launches.kernel if run.fused else run.launches.samples
        functions.append(weakref.ref(sample))
        kernels.append(weakref.ref(kernel))
        modules.append(len(wp._src.context.user_modules))
        del sample, run, kernel
        gc.collect()
    for gone in (functions, kernels):
        assert [reference() is None for reference in gone[:-1]] == [True] * 3  # Warp keeps the last of a name
    assert modules[1:] == modules[1:2] * 3


@pytest.mark.parametrize("fused", [None, False])
def test_trainers_of_one_function_share_kernels(fused):
    first, second = make_sample(0.5), make_sample(0.5)  # equal text: modules of one name, loaded twice
    runs = [trainer(sample, fused) for sample in (first, first, second)]
    kernels = [run.launches.kernel if run.fused else run.launches.samples for run in runs]
    losses = [run.run(4, quiet=True) for run in runs]
    assert kernels[0] is kernels[1] and losses[0] == losses[1] == losses[2]
    del runs[:2], kernels, first
    gc.collect()
    assert runs[0].run(4, quiet=True) < losses[0]  # what went took nothing from what is still there

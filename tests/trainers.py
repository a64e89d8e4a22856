"""Trainers of small networks on given pairs of inputs and targets, and the gradient that they are to find."""

from functools import cache

import numpy as np
import reference_networks as reference
import warp as wp
from networks import error, samples

import warp_neural as wn

BOUND = {"float32": 1e-5, "float16": 1e-2, "bfloat16": 4e-2}  # of a gradient's error; bfloat16 keeps 3 bits fewer


@wp.struct
class Pairs:
    x: wp.array2d[float]
    target: wp.array2d[float]


@cache
def make_sample(n_in: int, n_out: int):
    vec_in, vec_out = wp.types.vector(n_in, float), wp.types.vector(n_out, float)

    @wp.func
    def sample(index: int, random: wn.random.Stream, pairs: Pairs):
        row = index % pairs.x.shape[0]
        x = vec_in()
        target = vec_out()
        for k in range(pairs.x.shape[1]):
            x[k] = pairs.x[row, k]
        for n in range(pairs.target.shape[1]):
            target[n] = pairs.target[row, n]
        return x, target

    return sample


def pairs(n, net, device, seed=0):
    data = Pairs()
    x, target = samples(n, net.n_in, seed), samples(n, net.n_out, seed + 1)
    data.x, data.target = (wp.array(a, dtype=float, device=device) for a in (x, target))
    return data, x, target


def trainer(net, n, **options):
    data, x, target = pairs(n, net, net.device)
    result = wn.Trainer(net, sample=make_sample(net.n_in, net.n_out), data=data, **{"batch": n} | options)
    return result, x, target


def true_gradient(net, x, target):
    """Of the mean of squares, in the order of `net.master`."""
    functions = [reference.ACTIVATIONS[net.spec.activation_of(i).name] for i in range(len(net.spec.layers))]
    weights = [reference.rounded(w, net.precision) for w in net.weights]
    y = reference.mlp(weights, net.biases, functions, x)
    dy = 2 * (y - target) / target.size
    _, dw, db, _ = reference.mlp(weights, net.biases, functions, x, dy)
    return np.concatenate([np.concatenate([w.ravel(), b]) for w, b in zip(dw, db, strict=True)])


def check_gradient(net, n, **options):
    """Of n samples, within `BOUND` of float64; returns the trainer and the gradient of the network's parameters."""
    run, x, target = trainer(net, n, **options)
    gradient = run.gradient()[: net.spec.n_parameters]
    assert gradient.any() and error(gradient, true_gradient(net, x, target)) < BOUND[net.precision]
    return run, gradient


def check_encoded(net, n):
    """The fused gradient against that of the adjoint. float16 rounds dz and what lies between the layers, 5e-4 each."""
    gradients = [trainer(net, n, fused=fused)[0].gradient() for fused in (None, False)]
    assert error(*gradients) < 5e-3
    if net.encoding.n_parameters(net.n_in):
        assert error(*(g[net.encoding_start :] for g in gradients)) < 1e-2


def small(device, **options):
    return wn.MLP(4, 3, 16, 1, device=device, precision="float16", **options)

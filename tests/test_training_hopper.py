"""Training by warpgroups on Hopper: gradients of 64 and 128 neurons a layer, in one pass or two."""

import time
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from networks import error, random_biases
from trainers import check_encoded, check_gradient, trainer, true_gradient

import warp_neural as wn
from warp_neural import activations, encodings
from warp_neural.kernels.nn.losses import l2
from warp_neural.kernels.nn.spec import BFLOAT16, NetworkSpec
from warp_neural.kernels.training.fused import make_kernels
from warp_neural.kernels.training.lower import make_lower_kernel
from warp_neural.kernels.training.rooms import choose_schedule
from warp_neural.kernels.training.schedule import HOPPER_BYTES
from warp_neural.train.optim import SGD
from warp_neural.train.steps import load_for

# width, depth, n_in, n_out, precision, accumulation, hidden activation, samples
CASES = [
    (64, 1, 3, 3, "float16", "float16", activations.relu, 100),
    (64, 2, 64, 16, "float16", "float32", activations.relu, 700),
    (64, 2, 50, 9, "bfloat16", "float32", activations.relu, 300),
    (64, 3, 64, 8, "float16", "float16", activations.leaky_relu, 70000),
    (64, 2, 48, 9, "float16", "float32", activations.elu, 1000),
    (64, 3, 33, 5, "float16", "float32", activations.linear, 129),
    (128, 1, 128, 16, "float16", "float32", activations.relu, 500),
    (128, 2, 64, 3, "float16", "float16", activations.leaky_relu, 130),
    (128, 2, 100, 7, "bfloat16", "float32", activations.relu, 2000),
    (128, 3, 128, 16, "float16", "float16", activations.relu, 40000),
    (128, 3, 5, 1, "float16", "float32", activations.linear, 1),
]


@pytest.mark.parametrize("width, depth, n_in, n_out, precision, accumulation, activation, n", CASES)
def test_gradient(device, width, depth, n_in, n_out, precision, accumulation, activation, n):
    if device.is_cpu:
        pytest.skip("test_trainer_gradients has the CPU's")
    kind = {"precision": precision, "accumulation": accumulation, "activation": activation, "device": device}
    net = random_biases(wn.MLP(n_in, n_out, width, depth, seed=3, **kind))
    run, gradient = check_gradient(net, n)
    np.testing.assert_array_equal(gradient, run.gradient()[: net.spec.n_parameters])


@pytest.mark.parametrize("width, depth", [(64, 1), (64, 3), (128, 1), (128, 3)])
@pytest.mark.parametrize("encoding", [encodings.HashGrid(levels=5, log2_size=8), encodings.Frequency(6)])
def test_gradient_with_an_encoding(device, width, depth, encoding):
    if device.is_cpu:
        pytest.skip("test_trainer_gradients has the CPU's")
    net = random_biases(wn.MLP(2, 3, width, depth, encoding=encoding, device=device, precision="float16"))
    check_encoded(net, 1000)


@pytest.mark.parametrize("width, depth", [(64, 2), (128, 2), (128, 3)])
def test_batches_grow_and_add_up(device, width, depth):
    net = random_biases(wn.MLP(5, 3, width, depth, device=device, precision="float16"))
    run, x, target = trainer(net, 2000, batch=[300, 1000], batches=2, optimizer=SGD(lr=0.0))
    for n in (600, 2000):
        assert error(run.gradient()[: net.spec.n_parameters], true_gradient(net, x[:n], target[:n])) < 1e-2
        run.run(1, quiet=True)


vec40 = wp.types.vector(40, float)


@wp.func
def point(index: int, random: wn.random.Stream):
    return vec40(wn.random.uniform(random, 0)[0]), wp.vec3(0.25)


def test_threads_take_turns_with_the_setting_of_the_architecture(monkeypatch):
    """Each compiles for its own, and what was there before comes back."""
    seen, begun = {}, Barrier(2)

    def load(module, *_, **options):
        seen[module] = [wp.config.cuda_arch_suffix]
        time.sleep(0.05)
        seen[module].append(wp.config.cuda_arch_suffix)

    def compile_one(suffix):
        begun.wait()
        load_for(SimpleNamespace(module=suffix), SimpleNamespace(arch_suffix=suffix, threads=32), None)

    monkeypatch.setattr(wp, "load_module", load)
    for _ in range(3):
        with ThreadPoolExecutor(2) as pool:
            list(pool.map(compile_one, ["a", "f"]))
        assert seen == {"a": ["a", "a"], "f": ["f", "f"]} and wp.config.cuda_arch_suffix is None


@pytest.mark.parametrize("width, depth", [(64, 3), (128, 2), (128, 3)])
def test_compiles_for_hopper(width, depth, tmp_path, monkeypatch):
    monkeypatch.setattr(wp.config, "cuda_arch_suffix", "a")
    spec = NetworkSpec((40, *[width] * depth, 3), format=BFLOAT16)
    schedule = choose_schedule(spec, 90, HOPPER_BYTES)
    assert schedule.arch_suffix == "a"
    kernels = make_kernels(spec, schedule, point, l2)
    if schedule.lower:
        kernels.append(make_lower_kernel(spec, schedule, point, True))
    for i, kernel in enumerate(kernels):
        (artifact,) = wp.compile_aot_module(kernel.module, arch=90, module_dir=tmp_path / f"{i}")
        assert artifact.suffixes == [".sm90a", ".cubin"]

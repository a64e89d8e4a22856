"""Networks of rows of memory: equal to the same network of vectors, however the rows lie."""

import numpy as np
import pytest
import reference_encodings
import reference_networks
import warp as wp
from networks import bound, error, evaluate, random_biases, samples

import warp_neural as wn
from warp_neural import activations
from warp_neural.kernels.coopvec.cuda.warpgroup_rows import make_rows_schedule
from warp_neural.kernels.coopvec.rows import make_evaluate_kernel, make_warpgroup_kernel
from warp_neural.kernels.nn.spec import BFLOAT16, NetworkSpec
from warp_neural.kernels.training.schedule import HOPPER_BYTES
from warp_neural.nn.evaluation import launch_warpgroups


@pytest.mark.parametrize("n_in, width, precision", [(32, 32, "float16"), (48, 64, "float16"), (20, 16, "bfloat16")])
@pytest.mark.parametrize("accumulation", ["float16", "float32"])
def test_equals_the_network_of_vectors(device, n_in, width, precision, accumulation):
    if precision == "bfloat16" and accumulation == "float16":
        pytest.skip("bfloat16 sums in float32")
    kind = {"precision": precision, "accumulation": accumulation, "dtype": wp.float16, "device": device}
    net = random_biases(wn.MLP(n_in, 5, width, 2, **kind))
    x = samples(256, n_in).astype(np.float16)
    expected = evaluate(net, x).y
    for n in (1, 31, 64, 100, 256):
        assert (net.evaluate(x[:n]).numpy() == expected[:n]).all()
    wide = wp.array(np.hstack([x, x[:, :8]]), dtype=wp.float16, device=device)
    for first in (0, 1, 8):  # rows further apart, and not aligned to 16 bytes
        part = wide[:, first : first + n_in]
        assert (net.evaluate(part).numpy() == evaluate(net, part.numpy()).y).all()


@pytest.mark.parametrize("implementation", ["cooperative", "per_thread", "tiled"])
def test_with_an_encoding_and_of_every_implementation(device, implementation):
    kind = {"encoding": wn.encodings.TriangleWave(2), "implementation": implementation, "precision": "float32"}
    net, x = random_biases(wn.MLP(2, 3, 16, 1, device=device, **kind)), samples(70, 2)
    functions = [reference_networks.ACTIVATIONS[name] for name in ("relu", "linear")]
    encoded = reference_encodings.triangle_wave(x.astype(np.float64), 2)
    expected = reference_networks.mlp(net.weights, net.biases, functions, encoded)
    np.testing.assert_allclose(net.evaluate(x).numpy(), expected, rtol=1e-5, atol=1e-6)
    assert net.evaluate(np.zeros((0, 2), np.float32)).shape == (0, 3)


def test_inputs_that_do_not_fit(device):
    net = wn.MLP(2, 3, 16, 1, device=device)
    for x in (np.zeros((4, 3)), np.zeros(4), wp.zeros((4, 2), dtype=wp.float16, device=device)):
        with pytest.raises(wn.InputError, match=r"expected \[n, 2\] of float32"):
            net.evaluate(x)


def test_compiles_for_hopper(tmp_path):
    net = wn.MLP(64, 16, 64, 2, dtype=wp.float16, device="cpu")
    kernel = make_evaluate_kernel(net.of_row, net.vec_out)
    (artifact,) = wp.compile_aot_module(kernel.module, arch=90, module_dir=tmp_path)
    assert artifact.stat().st_size > 0


# n_in, width, depth, n_out, accumulation, activation
WARPGROUPS = [
    (64, 64, 2, 16, "float16", activations.relu),
    (48, 64, 3, 5, "float32", activations.tanh),
    (32, 32, 3, 16, "float16", activations.relu),
    (16, 32, 2, 7, "float32", activations.relu),
    (128, 64, 1, 8, "float16", activations.leaky_relu),
    (128, 128, 3, 16, "float16", activations.relu),
    (16, 128, 2, 1, "float32", activations.relu),
]


@pytest.mark.parametrize("n_in, width, depth, n_out, accumulation, activation", WARPGROUPS)
@pytest.mark.parametrize("n", [1, 63, 1000])
def test_warpgroups(device, n_in, width, depth, n_out, accumulation, activation, n):
    kind = {"activation": activation, "accumulation": accumulation, "dtype": wp.float16, "device": device}
    net, x = random_biases(wn.MLP(n_in, n_out, width, depth, **kind)), samples(n, n_in).astype(np.float16)
    schedule = make_rows_schedule(net.spec, 90, HOPPER_BYTES)
    if device.is_cpu or device.arch != 90:
        pytest.skip("only Hopper has them")
    y = wp.full((n + 1, n_out), 7.0, dtype=wp.float16, device=device)
    launch_warpgroups(net.spec, schedule, net.plain, wp.array(x, dtype=wp.float16, device=device), y)
    functions = [reference_networks.ACTIVATIONS[net.spec.activation_of(i).name] for i in range(depth + 1)]
    expected = reference_networks.mlp(net.weights, net.biases, functions, x.astype(np.float64))
    assert error(y.numpy()[:n], expected) < 2 * bound(net)
    assert (y.numpy()[n] == 7).all()


@pytest.mark.parametrize("n_in, width, depth, n_out, accumulation, activation", WARPGROUPS)
def test_warpgroups_compile_for_hopper(n_in, width, depth, n_out, accumulation, activation, tmp_path, monkeypatch):
    monkeypatch.setattr(wp.config, "cuda_arch_suffix", "a")
    kind = {"activation": activation, "accumulation": accumulation, "dtype": wp.float16}
    spec = NetworkSpec((n_in, *[width] * depth, n_out), **kind)
    schedule = make_rows_schedule(spec, 90, HOPPER_BYTES)
    kernel = make_warpgroup_kernel(spec, schedule)
    (artifact,) = wp.compile_aot_module(kernel.module, arch=90, module_dir=tmp_path)
    assert artifact.suffixes == [".sm90a", ".cubin"]


def test_what_warpgroups_take():
    def schedule(*sizes, arch=90, shared_bytes=HOPPER_BYTES, **kind):
        return make_rows_schedule(NetworkSpec(sizes, **{"dtype": wp.float16} | kind), arch, shared_bytes)

    assert schedule(64, 64, 64, 16) and schedule(128, 128, 128, 128, 3)
    for sizes in [(64, 16), (64, 48, 16), (64, 64, 128, 16), (40, 64, 16), (144, 64, 16), (64, 64, 17)]:
        assert schedule(*sizes) is None
    for other in [{"arch": 80}, {"dtype": wp.float32}, {"format": BFLOAT16}, {"shared_bytes": 40 << 10}]:
        assert schedule(128, 128, 16, **other) is None

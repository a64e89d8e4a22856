"""`Trainer`: gradients against float64 NumPy, and of the fused kernels against the adjoint of the loss."""

import pytest
from networks import error, random_biases
from trainers import check_encoded, check_gradient, trainer

import warp_neural as wn
from warp_neural import activations, encodings, losses

# width, depth, n_in, n_out, precision, accumulation, hidden activation, samples
CASES = [
    (16, 1, 2, 3, "float16", "float32", activations.relu, 70),
    (16, 5, 5, 16, "float16", "float16", activations.leaky_relu, 300),
    (32, 3, 32, 4, "float16", "float16", activations.relu, 1000),
    (32, 2, 20, 17, "bfloat16", "float32", activations.relu, 33),
    (32, 2, 2, 3, "float32", "float32", activations.silu, 100),
    (64, 2, 64, 16, "float16", "float32", activations.gelu, 600),
    (64, 2, 48, 9, "float16", "float32", activations.elu, 600),
    (32, 3, 7, 3, "bfloat16", "float32", activations.elu, 300),
    (64, 3, 10, 1, "float16", "float32", activations.relu, 1),
    (64, 4, 40, 5, "float16", "float32", activations.tanh, 200),
    (20, 2, 3, 3, "float16", "float32", activations.sine, 100),
    (128, 1, 8, 3, "float16", "float32", activations.relu, 50),
    (128, 3, 8, 3, "float32", "float32", activations.relu, 50),
    (16, 0, 7, 3, "float16", "float32", activations.relu, 100),
]


@pytest.mark.parametrize("width, depth, n_in, n_out, precision, accumulation, activation, n", CASES)
def test_gradient(device, width, depth, n_in, n_out, precision, accumulation, activation, n):
    kind = {"precision": precision, "accumulation": accumulation, "activation": activation, "device": device}
    net = random_biases(wn.MLP(n_in, n_out, width, depth, seed=1, **kind))
    run, _ = check_gradient(net, n)
    assert run.index == 0  # no step was taken


@pytest.mark.parametrize("precision", ["float32", "float16"])
@pytest.mark.parametrize("depth", range(1, 6))
@pytest.mark.parametrize("width", [16, 32, 64, 128])
def test_gradient_at_every_size(device, width, depth, precision):
    """Fused and taped.

    Where rounding moves a pre-activation past ReLU's zero, one sample's gradient is another. In float32 that is rare
    among few samples; in float16 it happens, and must be one of many: of 100 it may make an error of 2e-2.
    """
    net = random_biases(wn.MLP(8, 3, width, depth, seed=1, precision=precision, device=device))
    for fused in (None, False):
        check_gradient(net, 100 if precision == "float32" else 1000, fused=fused)


@pytest.mark.parametrize("seed", [9, 48], ids=["dead", "alive"])
def test_gradient_through_nine_layers_of_width_one(device, seed):
    """Without biases: a dead neuron passes on exactly 0, where ReLU's derivative is 0, for every sample."""
    net = wn.MLP(1, 1, 1, 8, seed=seed, precision="float32", device=device)
    for fused in (None, False):
        _, gradient = check_gradient(net, 100, fused=fused)
        assert (gradient != 0).sum() == {9: 1, 48: 18}[seed]


@pytest.mark.parametrize("activation", activations.ALL, ids=lambda a: a.name)
def test_fused_and_taped_gradients_agree(device, activation):
    if device.is_cpu and activation not in (activations.relu, activations.sine, activations.sigmoid):
        pytest.skip("the fused path of the CPU is compared in test_training_cpu")
    kind = {"activation": activation, "output_activation": activation, "device": device, "precision": "float16"}
    net = random_biases(wn.MLP(5, 3, 32, 2, seed=2, **kind))
    gradients = [trainer(net, 100, fused=fused)[0].gradient() for fused in (None, False)]
    assert error(*gradients) < 5e-3


ENCODINGS = [
    encodings.LatentTexture(8, 6, 4),
    encodings.Concatenate((encodings.Identity(), encodings.LatentTexture(5, 5, 3, wrap=True))),
    encodings.HashGrid(levels=4, log2_size=8, base_resolution=4),
    encodings.Frequency(3),
    encodings.TriangleWave(3),
    encodings.OneBlob(8),
    encodings.SphericalHarmonics(4),
]


@pytest.mark.parametrize("encoding", ENCODINGS, ids=lambda e: type(e).__name__)
def test_gradient_with_an_encoding(device, encoding):
    if device.is_cpu and encoding not in ENCODINGS[1:3]:
        pytest.skip("two of them are compiled for the CPU, all for CUDA")
    n_in = 3 if isinstance(encoding, encodings.SphericalHarmonics) else 2
    net = random_biases(wn.MLP(n_in, 3, 32, 2, encoding=encoding, device=device, precision="float16"))
    check_encoded(net, 100)


LOSSES = [losses.relative_l2.weighted(1, 10, 5), losses.cross_entropy, losses.l1, losses.l2, losses.relative_l1]
LOSSES += [losses.mape, losses.smape, losses.huber(0.5), losses.gamma_l2]


@pytest.mark.parametrize("loss", LOSSES, ids=lambda loss: loss.name)
def test_gradient_of_a_loss(device, loss):
    if device.is_cpu and loss not in LOSSES[:2]:
        pytest.skip("two of them are compiled for the CPU, all for CUDA")
    net = random_biases(wn.MLP(4, 3, 16, 1, device=device, precision="float16"))
    gradients = [trainer(net, 64, fused=fused, loss=loss)[0].gradient() for fused in (None, False)]
    assert error(*gradients) < 5e-3

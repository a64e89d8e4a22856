"""Second derivatives: the functions in PyTorch's operations are the kernels', and their derivatives right."""

import pytest
import warp as wp
from tcnn_vectors import ARRAYS, RECORDS, vectors
from test_torch import inputs, model
from torch_modules import make, tcnn, torch

import warp_neural as wn
from warp_neural import activations, encodings
from warp_neural.torch.twice import ACTIVATIONS, evaluate_twice

SUPPORTED = [
    name for name in RECORDS if not any(word in name for word in ("smoothstep", "nearest", "tiled2d", "act_ff_sine"))
]


def differs(result: torch.Tensor, expected: torch.Tensor) -> float:
    """As a share of the norm."""
    return ((result - expected).norm() / expected.norm()).item()


@pytest.mark.parametrize("name", SUPPORTED)
def test_values_are_the_kernels(name):
    module, expected = make(RECORDS[name]), vectors(name)
    module.load_tcnn_params(expected.params)
    x = torch.from_numpy(expected.x)
    with torch.no_grad():
        limit = 1e-6 if module.dtype is torch.float32 else 1e-3
        assert differs(evaluate_twice(module.shape, x, module.params), module(x).float()) < limit


@pytest.mark.parametrize("activation", activations.ALL, ids=lambda activation: activation.name)
def test_activations_are_the_kernels(activation):
    net = wn.MLP(3, 4, 16, 1, activation=activation, output_activation=activation, precision="float32", device="cpu")
    module, x = tcnn.from_warp(net), 2 * inputs(50)[:, :3] - 1
    with torch.no_grad():
        assert differs(evaluate_twice(module.shape, x, module.params), module(x)) < 2e-6
    assert activation in ACTIVATIONS


@pytest.mark.parametrize("name", ["dense2d_fp32", "hash3d_fp32"])
def test_second_derivatives_of_grids_are_tiny_cuda_nns(name, device):
    """Its fast exponentials shift the scales of the second."""
    expected, record = vectors(name), RECORDS[name]
    module = make(record).to(wp.device_to_torch(device))
    module.load_tcnn_params(expected.params)
    x, dy = (torch.from_numpy(values).to(module.params.device).requires_grad_() for values in (expected.x, expected.dy))
    (dx,) = torch.autograd.grad(module(x), x, dy, create_graph=True)
    (dx * torch.from_numpy(ARRAYS[f"inputs/{record['ddx']}"]).to(dx.device)).sum().backward()
    for result, key in ((dy.grad, "bb_ddy"), (x.grad, "bb_dx"), (module.params.grad, "bb_dparams")):
        assert differs(result.cpu(), torch.from_numpy(ARRAYS[f"{name}/{key}"])) < (3e-5 if "hash" in name else 1e-6)


def test_second_derivatives_are_derivatives_of_the_first(device):
    """First ones of float32 kernels at steps of 2e-3: their rounding is 1e-4 then, and truncation of this order too."""
    made, x = model(device=device), inputs(4, device).double().requires_grad_()
    dy = torch.linspace(0.5, 1.5, 12, dtype=torch.float32, device=x.device).reshape(4, 3)

    def slopes(x):
        return torch.autograd.grad(made(x), x, dy, create_graph=True)[0]

    torch.autograd.gradcheck(slopes, (x,), eps=2e-3, atol=2e-2, rtol=2e-2)
    loss = slopes(x).square().sum()
    (gradient,) = torch.autograd.grad(loss, made.params)
    assert all(not gradient[place].any() for place in made.shape.resting)
    direction = gradient / gradient.norm()
    values = []
    for sign in (-1, 1):
        with torch.no_grad():
            made.params += sign * 1e-2 * direction
        values.append(slopes(x).square().sum().item())
        with torch.no_grad():
            made.params -= sign * 1e-2 * direction
    assert (values[1] - values[0]) / 2e-2 == pytest.approx(gradient.norm().item(), rel=5e-3)


def test_a_signed_distance_trains(device):
    """Of a circle, from its outline and the eikonal equation alone: |gradient| is 1."""
    config = {"otype": "FullyFusedMLP", "activation": "Softplus", "n_neurons": 32, "n_hidden_layers": 2, "biases": True}
    made = tcnn.Network(2, 1, config, dtype=torch.float32).to(wp.device_to_torch(device))
    generator = torch.Generator().manual_seed(0)
    optimizer = torch.optim.Adam(made.parameters())
    for step in range(300):
        optimizer.param_groups[0]["lr"] = 1e-2 * (1 - step / 300)
        angle = 2 * torch.pi * torch.rand((64, 1), generator=generator)
        outline = 0.5 * torch.cat([torch.cos(angle), torch.sin(angle)], dim=1).to(made.params.device)
        x = (2 * torch.rand((64, 2), generator=generator) - 1).to(outline.device).requires_grad_()
        (slope,) = torch.autograd.grad(made(x).sum(), x, create_graph=True)
        loss = made(outline).square().mean() + 0.1 * (slope.norm(dim=1) - 1).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    radius = torch.linspace(0.35, 0.85, 6).to(outline.device)
    x = torch.stack([radius, 0 * radius], dim=1).requires_grad_()
    distance = made(x).squeeze(1)
    (slope,) = torch.autograd.grad(distance.sum(), x)
    torch.testing.assert_close(slope.norm(dim=1), torch.ones_like(radius), rtol=0, atol=0.1)
    torch.testing.assert_close(distance.detach().abs(), (radius - 0.5).abs(), rtol=0, atol=0.03)


def test_third_derivatives_are_pytorchs():
    """Of the Laplacian in the parameters, where biases rest."""

    def gradient(function) -> torch.Tensor:
        (slope,) = torch.autograd.grad(function(x).sum(), x, create_graph=True)
        seconds = [torch.autograd.grad(slope[:, i].sum(), x, create_graph=True)[0][:, i] for i in range(5)]
        return torch.autograd.grad(sum(seconds).square().sum(), made.params)[0]

    made, x = model(), inputs(4).requires_grad_()
    exact = gradient(lambda x: evaluate_twice(made.shape, x, made.params))
    for place in made.shape.resting:
        exact[place] = 0
    assert differs(gradient(made), exact) < 1e-4


def test_what_has_none_says_so():
    texture = encodings.LatentTexture(2, 2)
    net = wn.MLP(2, 1, 16, 1, encoding=texture, precision="float32", device="cpu")
    x = inputs(4)[:, :2].clone().requires_grad_()
    (slope,) = torch.autograd.grad(tcnn.from_warp(net)(x).sum(), x, create_graph=True)
    with pytest.raises(NotImplementedError, match="no second derivatives of encoding LatentTexture"):
        slope.sum().backward()

"""The modules as PyTorch's: gradients, batches, strides, copies, and their networks in Warp's kernels."""

import copy
import io
import pickle
import subprocess
import sys

import numpy as np
import pytest
import warp as wp
from torch_modules import gradients, tcnn, torch

import warp_neural as wn
from warp_neural import InputError
from warp_neural.torch.launches import backward_kernel, forward_kernel

MLP = {"otype": "FullyFusedMLP", "activation": "Tanh", "output_activation": "None", "n_neurons": 32}
MLP |= {"n_hidden_layers": 2}
GRID = {"otype": "HashGrid", "n_levels": 3, "log2_hashmap_size": 8, "base_resolution": 3, "per_level_scale": 1.7}
ENCODING = {
    "otype": "Composite",
    "nested": [GRID | {"n_dims_to_encode": 2}, {"otype": "SphericalHarmonics", "degree": 3}],
}


def model(dtype=torch.float32, device: wp.Device | None = None, **options) -> tcnn.Module:
    """5 inputs -> 21 -> 32 -> 32 -> 3; every kind of parameter, none of them tiny."""
    made = tcnn.NetworkWithInputEncoding(5, 3, ENCODING, MLP | options, dtype=dtype)
    with torch.no_grad():
        grid = made.params[made.shape.encoding_start :]
        grid.copy_(torch.rand(grid.shape, generator=torch.Generator().manual_seed(0)) - 0.5)
    return made.to(wp.device_to_torch(device)) if device else made


def inputs(n: int, device: wp.Device | str = "cpu") -> torch.Tensor:
    x = torch.rand((n, 5), generator=torch.Generator().manual_seed(n))
    return x.to(wp.device_to_torch(wp.get_device(device)))


@pytest.mark.parametrize("biases", [False, True])
def test_gradients_are_derivatives(biases, device):
    """Float32 inside: steps of 2e-3 have rounding errors of 1e-4, and where curvature changes by 1, truncation errors
    of less; no cell of the grid ends near the points."""
    made, x = model(biases=biases, device=device), inputs(6, device).double().requires_grad_()
    torch.autograd.gradcheck(made, (x,), eps=2e-3, atol=4e-3, rtol=2e-2)
    dy = torch.rand((6, 3), generator=torch.Generator().manual_seed(1)).to(x.device)
    (gradient,) = torch.autograd.grad((made(x) * dy).sum(), made.params)
    direction = torch.randn(gradient.shape, generator=torch.Generator().manual_seed(2)).to(x.device)
    for place in made.shape.resting:
        assert not gradient[place].any()
        direction[place] = 0
    direction /= direction.norm()
    losses = []
    for sign in (-1, 1):
        moved = {"params": made.params.detach() + sign * 1e-2 * direction}
        losses.append((torch.func.functional_call(made, moved, (x,)) * dy).sum().item())
    assert (losses[1] - losses[0]) / 2e-2 == pytest.approx((gradient @ direction).item(), rel=2e-3)
    assert (len(made.shape.resting) == 0) == biases


@pytest.mark.parametrize("dtype", [torch.float32, torch.float16])
def test_batches_of_any_size(dtype, device):
    """Each row by itself, whatever the batch; float32 sums of a batch in another order."""
    made, x = model(dtype, device), inputs(131, device)
    whole = made(x)
    assert whole.shape == (131, 3) and whole.dtype is dtype
    whole.float().sum().backward()
    gradient, made.params.grad = made.params.grad, None
    for start, end in ((0, 0), (0, 1), (1, 66), (66, 131)):
        part = made(x[start:end])
        assert torch.equal(part, whole[start:end])
        part.float().sum().backward()
    torch.testing.assert_close(made.params.grad, gradient, rtol=1e-4, atol=1e-4)


def test_an_empty_batch_has_gradients(device):
    made, x = model(device=device), inputs(0, device).requires_grad_()
    made(x).sum().backward()
    assert x.grad.shape == (0, 5) and not made.params.grad.any()


def test_inputs_of_any_strides_shape_and_type(device):
    made, x = model(device=device), inputs(24, device)
    y = made(x)
    wide = torch.zeros((24, 20), device=x.device)
    wide[:, 3:13:2] = x
    assert torch.equal(made(wide[:, 3:13:2]), y)
    assert torch.equal(made(x.T.contiguous().T), y)
    assert torch.equal(made(x.reshape(2, 3, 4, 5)), y.reshape(2, 3, 4, 3))
    assert torch.equal(made(x[0]), y[0])
    assert torch.equal(made(x[:1].expand(7, 5)), y[:1].expand(7, 3))
    assert torch.equal(made(x.double()), y)
    transposed = x.T.contiguous().T.requires_grad_()
    made(transposed).sum().backward()
    straight = x.clone().requires_grad_()
    made(straight).sum().backward()
    assert torch.equal(transposed.grad, straight.grad)
    strided = torch.ones((3, 24), device=x.device).T  # the gradient of the results, too
    made(straight).backward(strided)
    torch.testing.assert_close(straight.grad, 2 * transposed.grad)


def test_only_what_is_asked_for_is_computed(device):
    made, x = model(device=device), inputs(9, device)
    with torch.no_grad():
        assert not made(x).requires_grad
    with torch.inference_mode():
        made(x)
    made.params.requires_grad_(False)
    assert not made(x).requires_grad
    x.requires_grad_()
    made(x).sum().backward()
    assert x.grad.any() and made.params.grad is None


def test_parameters_that_change_before_the_backward_pass_are_noticed():
    made, x = model(), inputs(9)
    y = made(x)
    with torch.no_grad():
        made.params.mul_(2)
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        y.sum().backward()


def test_float16_is_float32_rounded(device):
    """Both of the same parameters; 2e-3 is four roundings of float16."""
    x, dy = inputs(64).numpy(), np.full((64, 3), 1e-5, np.float32)  # without loss scale below its smallest numbers
    for half, full in zip(
        gradients(model(torch.float16, device), x, dy), gradients(model(device=device), x, dy), strict=True
    ):
        assert np.linalg.norm(half - full) < 4e-3 * np.linalg.norm(full)


def test_it_trains_with_autocast_and_a_scaler():
    made = model(torch.float16)
    optimizer, scaler = torch.optim.Adam(made.parameters(), lr=1e-2), torch.amp.GradScaler("cpu")
    x = inputs(256)
    losses = []
    for _ in range(60):
        with torch.autocast("cpu", dtype=torch.bfloat16):
            loss = (made(x).float() - torch.sin(4 * x[:, :3])).square().mean()
        optimizer.zero_grad()
        scaler.scale(loss).backward()
        scaler.step(optimizer)
        scaler.update()
        losses.append(loss.item())
    assert losses[-1] < 0.1 * losses[0]


def test_copies_pickles_and_state_dicts():
    made, x = model(torch.float16), inputs(8)
    y = made(x)
    for again in (copy.deepcopy(made), pickle.loads(pickle.dumps(made))):
        assert torch.equal(again(x), y) and again.params.data_ptr() != made.params.data_ptr()
    file = io.BytesIO()
    torch.save(made.state_dict(), file)
    file.seek(0)
    fresh = tcnn.NetworkWithInputEncoding(5, 3, ENCODING, MLP, seed=7)
    assert not torch.equal(fresh(x), y)
    fresh.load_state_dict(torch.load(file))
    assert torch.equal(fresh(x), y)


def test_warp_without_pytorch_says_what_to_install():
    code = "import sys; sys.modules['torch'] = None; import warp_neural; import warp_neural.torch"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.stderr.endswith(
        "ModuleNotFoundError: warp_neural.torch needs PyTorch: pip install 'warp-neural[torch]'\n"
    )


@pytest.mark.parametrize("made", [model(torch.float16), tcnn.Encoding(2, GRID)], ids=["network", "encoding"])
def test_kernels_compile_for_hopper(made, tmp_path):
    for make in (forward_kernel, backward_kernel):
        (artifact,) = wp.compile_aot_module(make(made.shape).module, arch=90, module_dir=tmp_path)
        assert artifact.stat().st_size > 0


def test_a_network_in_warp_shares_the_parameters(device, tmp_path):
    made = model(torch.float32, device, activation="ReLU", biases=True)
    net, x = made.to_warp(), inputs(16, device)
    np.testing.assert_array_equal(net.evaluate(wp.from_torch(x)).numpy(), made(x).detach().cpu().numpy())
    with torch.no_grad():
        made.params.mul_(0.5)
    net.pack()
    y = made(x).detach().cpu().numpy()
    np.testing.assert_array_equal(net.evaluate(wp.from_torch(x)).numpy(), y)
    wn.save_network(tmp_path / "a.safetensors", net)
    again = tcnn.from_warp(wn.load_network(tmp_path / "a.safetensors", device=device))
    np.testing.assert_array_equal(again(x).detach().cpu().numpy(), y)


@wp.func
def sample(index: int, random: wn.random.Stream):
    u = wn.random.uniform(random, 0)
    return wp.vec2(u[0], u[1]), wp.vec3(u[0], u[1], u[0] * u[1])


def test_a_fused_step_trains_the_module(device):
    """`wn.Trainer` on the shared parameters, in place of PyTorch's loop."""
    made = tcnn.Network(2, 3, MLP, dtype=torch.float32).to(wp.device_to_torch(device))
    x = inputs(64, device)[:, :2]
    target = torch.stack([x[:, 0], x[:, 1], x[:, 0] * x[:, 1]], dim=1)
    before = (made(x) - target).square().mean().item()
    trainer = wn.Trainer(made.to_warp(), sample=sample, loss=wn.losses.l2, optimizer=wn.optim.Adam(lr=1e-2), batch=256)
    trainer.run(steps=100)
    assert (made(x) - target).square().mean().item() < 0.05 * before


@pytest.mark.parametrize("precision", ["float32", "float16", "bfloat16"])
def test_a_network_of_warp_trains_in_pytorch(precision, device):
    net = wn.MLP(2, 3, 32, 2, encoding=wn.encodings.Frequency(3), precision=precision, device=device)
    made = tcnn.from_warp(net)
    assert made.dtype is (torch.float16 if precision == "float16" else torch.float32)
    x = inputs(64, device)[:, :2]
    optimizer = torch.optim.SGD(made.parameters(), lr=0.1)
    before = net.master.numpy().copy()
    made(x).float().square().mean().backward()
    optimizer.step()
    net.pack()
    assert not np.array_equal(net.master.numpy(), before)
    y = net.evaluate(wp.from_torch(x.contiguous())).numpy()
    assert torch.equal(made(x).detach().cpu(), torch.from_numpy(y).to(made.dtype))


def test_networks_that_cannot_be_shared():
    with pytest.raises(InputError, match="2 networks; a module has one"):
        tcnn.from_warp(wn.MLP(2, 3, count=2, device="cpu"))
    with pytest.raises(InputError, match=r"int8 networks are trained by wn\.Trainer"):
        tcnn.from_warp(wn.MLP(2, 3, precision="int8", device="cpu"))
    with pytest.raises(InputError, match="an encoding without a network"):
        tcnn.Encoding(2, {"otype": "Frequency"}).to_warp()
    net = wn.MLP(2, 3, 16, 1, device="cpu")
    with pytest.raises(InputError, match=r"share: float32 \(7,\) on cpu; expected float32 \(99,\) on cpu"):
        net.share(wp.zeros(7, dtype=float, device="cpu"))
    with pytest.raises(InputError, match="share: memory with gaps, or not aligned to 16 bytes"):
        net.share(wp.zeros(100, dtype=float, device="cpu")[1:])

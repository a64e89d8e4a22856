"""`Trainer`: gradients against float64 NumPy and the tape, samples, steps that go wrong, checkpoints."""

import errno
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import reference_networks as reference
import warp as wp
from networks import error, random_biases, samples

import warp_neural as wn
from kernels.training.plan import make_plan
from warp_neural import activations, encodings, losses
from warp_neural.optim import SGD, Adam, linear


@wp.struct
class Pairs:
    x: wp.array2d[float]
    target: wp.array2d[float]


@cache
def make_sample(n_in: int, n_out: int):
    vec_in, vec_out = wp.types.vector(n_in, float), wp.types.vector(n_out, float)

    @wp.func
    def sample(index: int, random: wp.uint32, pairs: Pairs):
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
    x, target = samples(n, net.n_in, seed), samples(n, net.spec.sizes[-1], seed + 1)
    data.x, data.target = (wp.array(a, dtype=float, device=device) for a in (x, target))
    return data, x, target


def trainer(net, n, **options):
    data, x, target = pairs(n, net, net.device)
    result = wn.Trainer(net, sample=make_sample(net.n_in, net.spec.sizes[-1]), data=data, **{"batch": n} | options)
    return result, x, target


def true_gradient(net, x, target):
    """Of the mean of squares, in the order of `net.master`."""
    functions = [reference.ACTIVATIONS[net.spec.activation_of(i).name] for i in range(len(net.spec.layers))]
    weights = [reference.rounded(w, net.spec.format.name) for w in net.weights]
    y = reference.mlp(weights, net.biases, functions, x)
    dy = 2 * (y - target) / target.size
    _, dw, db, _ = reference.mlp(weights, net.biases, functions, x, dy)
    return np.concatenate([np.concatenate([w.ravel(), b]) for w, b in zip(dw, db, strict=True)])


# width, depth, n_in, n_out, precision, accumulation, hidden activation, samples
CASES = [
    (16, 1, 2, 3, "float16", "float32", activations.relu, 70),
    (16, 5, 5, 16, "float16", "float16", activations.leaky_relu, 300),
    (32, 3, 32, 4, "float16", "float16", activations.relu, 1000),
    (32, 2, 20, 17, "bfloat16", "float32", activations.relu, 33),
    (32, 2, 2, 3, "float32", "float32", activations.silu, 100),
    (64, 2, 64, 16, "float16", "float32", activations.gelu, 600),
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
    run, x, target = trainer(net, n)
    bound = {"float32": 1e-5, "float16": 1e-2, "bfloat16": 4e-2}[precision]  # bfloat16 keeps 3 bits fewer
    assert error(run.gradient()[: net.n_parameters], true_gradient(net, x, target)) < bound
    assert run.gradient().any()  # and no step was taken
    assert run.index == 0


@pytest.mark.parametrize("activation", activations.ALL, ids=lambda a: a.name)
def test_fused_and_general_gradients_agree(device, activation):
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
    gradients = [trainer(net, 100, fused=fused)[0].gradient() for fused in (None, False)]
    assert error(*gradients) < 5e-3
    if encoding.n_parameters(n_in):
        taped, mine = (g[net.encoding_start :] for g in gradients)
        assert error(taped, mine) < 1e-2


LOSSES = [losses.relative_l2.weighted(1, 10, 5), losses.cross_entropy, losses.l1, losses.l2, losses.relative_l1]
LOSSES += [losses.mape, losses.smape, losses.huber(0.5), losses.gamma_l2]


@pytest.mark.parametrize("loss", LOSSES, ids=lambda loss: loss.name)
def test_gradient_of_a_loss(device, loss):
    if device.is_cpu and loss not in LOSSES[:2]:
        pytest.skip("two of them are compiled for the CPU, all for CUDA")
    net = random_biases(wn.MLP(4, 3, 16, 1, device=device, precision="float16"))
    gradients = [trainer(net, 64, fused=fused, loss=loss)[0].gradient() for fused in (None, False)]
    assert error(*gradients) < 5e-3


def small(device, **options):
    return wn.MLP(4, 3, 16, 1, device=device, precision="float16", **options)


def test_several_batches_are_one_larger(device):
    net = random_biases(small(device))
    whole, x, target = trainer(net, 192)
    parts, _, _ = trainer(net, 192, batch=64, batches=3)
    assert error(parts.gradient(), whole.gradient()) < 1e-6
    assert error(parts.gradient()[: net.n_parameters], true_gradient(net, x, target)) < 1e-2


def test_batch_grows_with_the_steps(device):
    net = random_biases(small(device))
    growing, x, target = trainer(net, 96, batch=[32, 96], optimizer=SGD(lr=0.0))
    expected = [true_gradient(net, x[:n], target[:n]) for n in (32, 96, 96)]
    for gradient in expected:
        assert error(growing.gradient()[: net.n_parameters], gradient) < 1e-2
        growing.run(1, quiet=True)


@pytest.mark.parametrize("optimizer", [Adam(lr=linear(1e-2, 1e-3, 20), weight_decay=0.1), SGD(lr=0.1, momentum=0.9)])
def test_steps_of_the_optimizer(device, optimizer):
    """As `Adam.step` and `SGD.step`, which test_optim compares with NumPy, take them from the same gradients."""
    net = random_biases(small(device))
    run, _, _ = trainer(net, 64, optimizer=optimizer, average=0.9)
    values = wp.clone(net.master)
    values.requires_grad = True
    kind = {Adam: {"weight_decay": 0.1}, SGD: {"momentum": 0.9}}[type(optimizer)]
    twin = type(optimizer)(values, lr=optimizer.lr, **kind)
    history = []
    for _ in range(3):
        values.grad.assign(run.gradient())
        run.run(1, quiet=True)
        twin.step()
        history.append(values.numpy().copy())
        np.testing.assert_allclose(net.master.numpy(), history[-1], rtol=2e-5, atol=1e-7)
    np.testing.assert_allclose(run.averaged, np.mean(history, 0), rtol=1e-4, atol=1e-6)


@wp.func
def line(index: int, random: wp.uint32):
    u = wp.randf(random)
    v = wp.randf(random)
    return wp.vec2(u, v), wp.vec3(u, v, 0.5 * (u + v))


def test_learns_draws_anew_and_stops_early(device):
    net = wn.MLP(2, 3, 16, 1, device=device, precision="float16")
    run = wn.Trainer(net, sample=line, optimizer=Adam(lr=1e-2), batch=256)
    loss = run.run(2000, target=1e-3, quiet=True)
    assert loss < 1e-3 and run.index < 2000 and run.index % 32 == 0
    assert len(run.losses) == run.index and run.losses[0] > 10 * loss
    assert len(np.unique(run.losses)) > 0.9 * run.index  # other samples at each step
    assert np.isnan(wn.Trainer(net, sample=line).run(0))


def test_same_seed_same_run(device):
    def after(seed, steps):
        net = wn.MLP(2, 3, 16, 1, device=device, precision="float16")
        run = wn.Trainer(net, sample=line, batch=100, seed=seed)
        run.run(steps, quiet=True)
        return net.master.numpy().copy()

    assert (after(0, 40) == after(0, 40)).all()
    assert (after(0, 40) != after(1, 40)).any()


def test_data_that_is_not_finite_stops_the_run_and_changes_nothing(device):
    net = small(device)
    run, _, target = trainer(net, 64)
    target[5, 1] = np.nan
    run.launches.data.target.assign(target)
    before = net.master.numpy().copy()
    with pytest.raises(wn.InputError, match="step 32: no gradient was finite"):
        run.run(100, quiet=True)
    assert run.skipped == 32 and (net.master.numpy() == before).all()


def test_wild_learning_rate_ends_in_a_message_or_finite_numbers(device):
    net = small(device)
    run, _, _ = trainer(net, 64, optimizer=SGD(lr=1e6))
    try:
        run.run(100, quiet=True)
    except wn.InputError as stopped:
        assert "learning rate" in str(stopped)
    assert np.isfinite(net.master.numpy()).all()


def test_scale_of_gradients_backs_off(device):
    net = small(device)
    run, _, target = trainer(net, 64, optimizer=SGD(lr=0.0))
    if not (run.fused and device.is_cuda):
        pytest.skip("only CUDA's fused gradients are in float16")
    run.launches.data.target.assign(target * 3000)  # 128 times the gradient exceeds 65,504
    run.run(16, quiet=True)
    assert 0 < run.skipped < 16 and run.progress.scale.numpy()[run.index % 2] == 128 / 2**run.skipped


def test_resume_goes_on_bit_for_bit(device, tmp_path):
    def fresh():
        net = wn.MLP(2, 3, 16, 1, device=device, precision="float16", encoding=encodings.Frequency(2))
        return wn.Trainer(net, sample=line, batch=100, average=0.9, optimizer=Adam(lr=linear(1e-2, 1e-3, 80)))

    run = fresh()
    run.run(40, quiet=True)
    assert run.run(0, checkpoint=tmp_path / "run.safetensors") == run.loss
    run.run(50, quiet=True)
    again = fresh()
    again.load(tmp_path / "run.safetensors")
    assert again.index == 40
    again.run(50, quiet=True)
    assert (again.net.master.numpy() == run.net.master.numpy()).all()
    assert (again.averaged == run.averaged).all() and (again.losses == run.losses).all()


def test_killed_run_resumes_from_its_last_checkpoint(tmp_path, monkeypatch):
    def fresh():
        return wn.Trainer(wn.MLP(2, 3, 16, 1, device="cpu", precision="float16"), sample=line, batch=64)

    whole, killed, path = fresh(), fresh(), tmp_path / "run.safetensors"
    whole.run(160, quiet=True)
    launch = killed._launch

    def launch_or_die(steps):
        if killed.index >= 96:
            raise KeyboardInterrupt
        launch(steps)

    monkeypatch.setattr("warp_neural.trainer.SAVE_SECONDS", 0)
    monkeypatch.setattr(killed, "_launch", launch_or_die)
    with pytest.raises(KeyboardInterrupt):
        killed.run(160, checkpoint=path, quiet=True)
    again = fresh()
    again.load(path)
    assert again.index == 96
    again.run(160 - again.index, quiet=True)
    assert (again.net.master.numpy() == whole.net.master.numpy()).all()


def test_bad_checkpoints_change_nothing(tmp_path, monkeypatch):
    def fresh(width=16, seed=0):
        return wn.Trainer(wn.MLP(2, 3, width, 1, device="cpu", precision="float16"), sample=line, batch=64, seed=seed)

    run, path = fresh(), tmp_path / "run.safetensors"
    run.run(3, quiet=True)
    run.save(path)
    whole = path.read_bytes()
    for size in (0, 10, len(whole) // 2, len(whole) - 1):
        (tmp_path / "cut.safetensors").write_bytes(whole[:size])
        with pytest.raises(wn.InputError, match=r"cut.safetensors"):
            run.load(tmp_path / "cut.safetensors")
    for other, message in ((fresh(width=32), "another network, float16 2-16-3"), (fresh(seed=1), "another seed")):
        before = other.net.master.numpy().copy()
        with pytest.raises(wn.InputError, match=message):
            other.load(path)
        assert other.index == 0 and (other.net.master.numpy() == before).all()
    with pytest.raises(wn.InputError, match="no such file"):
        run.load(tmp_path / "none.safetensors")
    wn.save_network(run.net, tmp_path / "net.safetensors")
    with pytest.raises(wn.InputError, match="not a checkpoint"):
        run.load(tmp_path / "net.safetensors")

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    run.run(1, quiet=True)
    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(wn.InputError, match="No space left"):
        run.save(path)
    assert path.read_bytes() == whole


@pytest.mark.parametrize(
    "options, message",
    [
        ({"batch": 0}, "at least one sample"),
        ({"batch": []}, "at least one sample"),
        ({"batch": 1.5}, "at least one sample"),
        ({"batches": 0}, "needs at least one"),
        ({"average": 1.0}, r"lies in \[0, 1\)"),
    ],
)
def test_arguments_that_make_no_sense(options, message):
    with pytest.raises(wn.InputError, match=message):
        trainer(small("cpu"), 8, **options)
    with pytest.raises(wn.InputError, match="0 or more"):
        trainer(small("cpu"), 8)[0].run(-1)
    with pytest.raises(wn.InputError, match="count=2"):
        trainer(small("cpu", count=2), 8)


def test_which_networks_have_a_plan():
    """Shared memory and registers are enough up to these depths, on an H200 and on a GeForce."""
    for shared, shapes in ((227, ((16, 8), (32, 5), (64, 4))), (99, ((16, 5), (32, 3)))):
        for width, depth in shapes:
            plan = make_plan(wn.MLP(width, 16, width, depth, device="cpu").spec, shared * 1024)
            assert plan.words * 4 <= (shared - 15) * 1024 and plan.sums <= 208
    assert make_plan(wn.MLP(128, 16, 128, 3, device="cpu").spec) is None
    assert make_plan(wn.MLP(64, 16, 64, 3, device="cpu").spec, 99 * 1024) is None

"""`Trainer`: samples, batches, steps of the optimizer and those that go wrong, checkpoints."""

import errno
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from networks import error, random_biases
from trainers import small, trainer, true_gradient

import warp_neural as wn
from warp_neural import encodings
from warp_neural.io.tensors import load_tensors, save_tensors
from warp_neural.train.optim import SGD, Adam, linear


def test_several_batches_are_one_larger(device):
    net = random_biases(small(device))
    whole, x, target = trainer(net, 192)
    parts, _, _ = trainer(net, 192, batch=64, batches=3)
    assert error(parts.gradient(), whole.gradient()) < 1e-6
    assert error(parts.gradient()[: net.spec.n_parameters], true_gradient(net, x, target)) < 1e-2


def test_batch_grows_with_the_steps(device):
    net = random_biases(small(device))
    growing, x, target = trainer(net, 96, batch=[32, 96], optimizer=SGD(lr=0.0))
    expected = [true_gradient(net, x[:n], target[:n]) for n in (32, 96, 96)]
    for gradient in expected:
        assert error(growing.gradient()[: net.spec.n_parameters], gradient) < 1e-2
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
def line(index: int, random: wn.random.Stream):
    numbers = wn.random.uniform(random, 0)
    u, v = numbers[0], numbers[1]
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

    monkeypatch.setattr("warp_neural.train.trainer.SAVE_SECONDS", 0)
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
    for other, message in (
        (fresh(width=32), "another network, 2-16-3, relu, linear, float16, cooperative, and this is 2-32-3"),
        (fresh(seed=1), "another seed"),
    ):
        before = other.net.master.numpy().copy()
        with pytest.raises(wn.InputError, match=message):
            other.load(path)
        assert other.index == 0 and (other.net.master.numpy() == before).all()
    with pytest.raises(wn.InputError, match="no such file"):
        run.load(tmp_path / "none.safetensors")
    wn.save_network(tmp_path / "net.safetensors", run.net)
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
    ("options", "name"),
    [
        ({"batch": 65}, "batch"),
        ({"batch": [32, 64]}, "batch"),
        ({"optimizer": Adam(lr=2e-3)}, "rate"),
        ({"optimizer": Adam(weight_decay=0.1)}, "settings"),
        ({"optimizer": SGD(lr=1e-3)}, "optimizer, settings"),
        ({"average": 0.8}, "decay"),
        ({"loss": wn.losses.l1}, "loss"),
        ({"loss": wn.losses.l2.weighted(1, 2, 3)}, "loss"),
        ({"loss_scale": 2.0}, "loss scale"),
    ],
)
def test_checkpoints_of_another_run_are_refused(tmp_path, options, name):
    def fresh(**options):
        net = wn.MLP(2, 3, 16, 1, device="cpu", precision="float16")
        return wn.Trainer(net, sample=line, **{"batch": 64, "average": 0.9} | options)

    run, path = fresh(), tmp_path / "run.safetensors"
    run.save(path)
    with pytest.raises(wn.InputError, match=f"of a run with another {name}; make the Trainer with the same") as error:
        fresh(**options).load(path)
    assert "\n" not in str(error.value)


def test_damaged_moments_are_refused_by_name(tmp_path):
    run, path = wn.Trainer(wn.MLP(2, 3, 16, 1, device="cpu"), sample=line, batch=64), tmp_path / "run.safetensors"
    run.run(3, quiet=True)
    run.save(path)
    before = run.net.master.numpy().copy()
    for name in ("first", "second", "scale"):
        tensors, metadata = load_tensors(path)
        tensors[f"training.{name}"][-1] = np.nan
        save_tensors(tmp_path / "bad.safetensors", tensors, metadata)
        with pytest.raises(wn.InputError, match=f"bad.safetensors: tensor 'training.{name}' holds NaN"):
            run.load(tmp_path / "bad.safetensors")
    save_tensors(tmp_path / "old.safetensors", tensors, metadata | {"version": 1})
    with pytest.raises(wn.InputError, match="a checkpoint of version 1, not 2; train again"):
        run.load(tmp_path / "old.safetensors")
    assert (run.net.master.numpy() == before).all() and run.index == 3


def test_what_is_told_is_read_only():
    net = wn.MLP(2, 3, 16, 1, device="cpu", precision="float16")
    run = wn.Trainer(net, sample=line, batch=[64, 128], average=0.9, optimizer=SGD(lr=0.1))
    run.run(2, quiet=True)
    for array in (run.losses, run.averaged, run.optimizer.lr):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 1
    assert str(run) == (
        "Trainer(MLP(2-16-3, relu, linear, float16, cooperative, cpu), l2, SGD(lr=0.1, momentum=0, weight_decay=0), "
        "batch=64 to 128, step 2, fused)"
    )


@pytest.mark.parametrize(
    "options, message",
    [
        ({"batch": 0}, "expected at least one sample"),
        ({"batch": []}, "expected at least one sample"),
        ({"batch": 1.5}, "expected at least one sample"),
        ({"batches": 0}, "batches=0: expected a whole number"),
        ({"average": 1.0}, r"average=1.0: expected the decay of an average, in \[0, 1\)"),
        ({"loss": "l2"}, "loss='l2': expected one of wn.losses"),
        ({"loss": wn.losses.l2.weighted(1, 2)}, "2 weights for 3 components"),
        ({"optimizer": "adam"}, "optimizer='adam': expected Adam or SGD"),
        ({"loss_scale": 0}, "loss_scale=0: expected a positive number"),
        ({"loss_scale": 1e300}, r"loss_scale=1e\+300: expected a positive number of float32"),
        ({"loss_scale": 1e-40}, "loss_scale=1e-40: expected a positive number of float32"),
        ({"average": 1 - 1e-12}, "expected the decay of an average"),
        ({"seed": 0.5}, "seed=0.5: expected a whole number"),
    ],
)
def test_arguments_that_make_no_sense(options, message):
    with pytest.raises(wn.InputError, match=message):
        trainer(small("cpu"), 8, **options)
    with pytest.raises(wn.InputError, match="steps=-1: expected a whole number >= 0"):
        trainer(small("cpu"), 8)[0].run(-1)
    with pytest.raises(wn.InputError, match="count=2"):
        trainer(small("cpu", count=2), 8)

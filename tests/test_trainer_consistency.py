"""`Trainer`: what stands between two steps, after Ctrl-C, after `gradient()`, with gradients that others left."""

import numpy as np
import pytest
import warp as wp
from networks import error, random_biases
from test_trainer import line
from trainers import trainer

import warp_neural as wn
from warp_neural.kernels.nn.activations import Activation

both = pytest.mark.parametrize("fused", [None, False])


def fresh(fused, device="cpu", **options):
    net = wn.MLP(2, 3, 16, 1, device=device, precision="float16", encoding=wn.encodings.LatentTexture(4, 4, 8))
    return wn.Trainer(net, sample=line, batch=64, fused=fused, **options)


def same(a, b):
    return (a.net.master.numpy() == b.net.master.numpy()).all() and (a.losses == b.losses).all()


@both
@pytest.mark.parametrize("place", range(12))
def test_interrupted_anywhere_goes_on_as_if_nothing_had_been(fused, place, monkeypatch):
    """Ctrl-C between any two launches: the steps that the device took count, what follows is bit for bit the same."""
    whole, stopped = fresh(fused, batches=2), fresh(fused, batches=2)
    whole.run(8, quiet=True)
    launch, launches = wp.launch, 0

    def launch_or_stop(*arguments, **options):
        nonlocal launches
        launches += 1
        if launches == 9 + place:
            raise KeyboardInterrupt
        return launch(*arguments, **options)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(wp, "launch", launch_or_stop)
        stopped.run(8, quiet=True)
    assert stopped.index < 8 and stopped.index == stopped.progress.counters.numpy()[0]
    packed = stopped.net.packed.numpy()
    stopped.net.pack()
    assert (stopped.net.packed.numpy() == packed).all()  # of the parameters as they are
    stopped.run(8 - stopped.index, quiet=True)
    assert same(stopped, whole)


@both
def test_looking_at_the_gradient_changes_nothing(device, fused):
    looked, plain = (fresh(fused, device) for _ in range(2))
    for run in (looked, plain):
        for _ in range(4):
            if run is looked:
                assert (run.gradient() == run.gradient()).all() or device.is_cuda
            run.run(1, quiet=True)
    if device.is_cuda:
        np.testing.assert_allclose(looked.losses, plain.losses, rtol=1e-3)  # gradients are added atomically
    else:
        assert same(looked, plain)


@both
def test_gradients_of_others_do_not_enter_a_step(device, fused):
    stained, clean = (fresh(fused, device) for _ in range(2))
    for run in (stained, clean):
        for _ in range(2):
            if run is stained:
                run.net.gradient.fill_(1e3)
            run.run(2, quiet=True)
    np.testing.assert_allclose(stained.net.master.numpy(), clean.net.master.numpy(), rtol=1e-3, atol=1e-5)


def overflowing(device, fused, precision, weight, **options):
    """A network whose gradient to its encoding is that to its neurons times 16 `weight`."""
    encoding = wn.encodings.LatentTexture(4, 4, 8)
    net = wn.MLP(2, 3, 16, 1, encoding=encoding, precision=precision, device=device)
    net.weights = [np.full((16, 8), weight), np.full((3, 16), 0.5)]
    net.biases = [np.ones(16), np.zeros(3)]
    net.master[net.encoding_start :].zero_()  # results and gradients of weights stay small
    return wn.Trainer(net, sample=line, batch=64, optimizer=wn.optim.SGD(lr=1e-6), fused=fused, **options)


@both
def test_gradients_to_encodings_that_overflow_skip_the_step(fused, device):
    """Those of weights and the loss are finite: nothing else tells, and tables must not become NaN."""
    if device.is_cuda and fused is None:
        pytest.skip("float16's are in the next test")
    run = overflowing(device, fused, "float32", 1e10, loss_scale=1e28)
    before = run.net.master.numpy()
    run.run(4, quiet=True)
    assert run.skipped == 4 and (run.net.master.numpy() == before).all()
    calm = overflowing(device, fused, "float32", 1e3, loss_scale=1e28)
    calm.run(4, quiet=True)
    assert calm.skipped == 0


@pytest.mark.cuda
def test_scale_backs_off_from_gradients_to_encodings(device):
    run = overflowing(device, None, "float16", 50.0)
    if not (run.fused and device.is_cuda):
        pytest.skip("only CUDA's fused gradients are in float16")
    run.run(20, quiet=True)
    assert 0 < run.skipped < 20 and run.progress.scale.numpy()[run.index % 2] == 128 / 2**run.skipped
    assert np.isfinite(run.net.master.numpy()).all()


@pytest.mark.parametrize("value, derivative", [
    ("z + 0.3f * wp::sin(z)", "1.0f + 0.3f * wp::cos(z)"),
    ("z > 0.0f ? z : 0.1f * z", "z > 0.0f ? 1.0f : 0.1f"),
    ("wp::max(z, 0.0f) - 0.1f * wp::max(-z, 0.0f)", "(z > 0.0f) - (z < 0.0f) * -0.1f"),
])  # fmt: skip
def test_an_activation_whose_text_is_a_sum(value, derivative):
    own = Activation("own", value, derivative)
    kind = {"activation": own, "output_activation": own, "precision": "float32", "device": "cpu"}
    net = random_biases(wn.MLP(4, 3, 16, 2, **kind))
    gradients = [trainer(net, 100, fused=fused)[0].gradient() for fused in (None, False)]
    assert error(*gradients) < 1e-5


@pytest.mark.parametrize("data", [None, 0, "none", wp.vec3(), np.float32(1)], ids=repr)
def test_data_that_the_sample_cannot_read(data):
    net = wn.MLP(1, 1, 16, 1, device="cpu")
    for sample in (from_array, from_struct):
        with pytest.raises(wn.InputError, match=r"data=.*: expected a"):
            wn.Trainer(net, sample=sample, data=data)


def test_data_of_another_kind():
    net = wn.MLP(1, 1, 16, 1, device="cpu")
    for array in (wp.zeros(3, dtype=wp.vec3), wp.zeros((3, 3), dtype=float), wp.zeros(3, dtype=wp.float64)):
        with pytest.raises(wn.InputError, match=r"data='array of .*, . dim.*': expected an array of float32 with 1"):
            wn.Trainer(net, sample=from_array, data=array)
    with pytest.raises(wn.InputError, match="expected a Points, which sample reads"):
        wn.Trainer(net, sample=from_struct, data=net.params)
    points = Points()
    points.x = wp.ones(3, dtype=float, device="cpu")
    for sample, data in ((from_array, points.x), (from_array, points.x.numpy()), (from_struct, points)):
        assert wn.Trainer(net, sample=sample, data=data, batch=8).run(1, quiet=True) >= 0


vec1 = wp.types.vector(1, float)


@wp.struct
class Points:
    x: wp.array[float]


@wp.func
def from_array(index: int, random: wn.random.Stream, data: wp.array[float]):
    return vec1(data[index % 3]), vec1(1.0)


@wp.func
def from_struct(index: int, random: wn.random.Stream, data: Points):
    return vec1(data.x[index % 3]), vec1(1.0)

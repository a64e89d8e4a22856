"""Other libraries in `perf.peers_cuda`: what is not there or fails stops nothing; PyTorch's part on the CPU."""

import numpy as np
import pytest

from perf import peers_cuda, training
from perf.measure import Bench, Config
from perf.networks import make_net, truth
from perf.peers import mean_square


@pytest.fixture
def bench():
    return Bench("inference", Config(device="cpu", rounds=2))


def test_nothing_installed(bench, monkeypatch):
    monkeypatch.setattr(peers_cuda, "find_spec", lambda name: None)
    net = make_net(2, 32, seed=0, device="cpu")
    x, target = training.make_rows(bench.config, 32, 64)
    peers_cuda.measure_inference(bench, net, x)
    peers_cuda.measure_training(bench, net, x, target)
    assert bench.result.figures == [] and bench.result.settings["peers installed"] == "none"


def test_what_fails_is_noted(bench):
    def broken():
        raise RuntimeError("no compiler\nand more")

    timed = peers_cuda.frozen_times
    peers_cuda.add(bench, "memory, torch.compile", "3x64", broken, timed)
    assert bench.result.figures == []
    assert bench.result.settings["memory, torch.compile, 3x64 failed"] == "no compiler"
    peers_cuda.add(bench, "memory, PyTorch eager", "3x64", lambda: lambda: None, timed)
    figure = bench.result.find("memory, PyTorch eager", "3x64")
    assert figure.unit == "ms" and figure.text().endswith("(frozen calls)")


def test_tinycudann_is_compared_without_biases():
    net, x = make_net(2, 32, seed=0, device="cpu"), np.ones((1, 32), np.float32)
    bare = peers_cuda.compared(net, "tinycudann")
    w0, w1, w2 = (w.astype(np.float16).astype(float) for w in net.weights)
    expected = w2 @ np.maximum(w1 @ np.maximum(w0 @ x[0], 0), 0)
    np.testing.assert_allclose(truth(bare, x)[0], expected, rtol=1e-12)
    assert peers_cuda.compared(net, "PyTorch eager") is net


def test_pytorch():
    """Inference and gradient are compared with float64 inside; a wrong one raises."""
    pytest.importorskip("torch")
    net = make_net(2, 32, seed=0, device="cpu")
    x, target = training.make_rows(Config(), 32, 256)
    (module,) = peers_cuda.modules(net, "cpu", ["torch"], compiled=False).values()
    step = peers_cuda.torch_training("PyTorch eager", net, module, x, target, "cpu")
    step()
    with pytest.raises(RuntimeError, match="relative error"):  # the step has changed it
        for _ in range(20):
            step()
        peers_cuda.torch_inference("PyTorch eager", net, module, x, "cpu")
    (module,) = peers_cuda.modules(net, "cpu", ["torch"], compiled=False).values()
    assert peers_cuda.torch_inference("PyTorch eager", net, module, x, "cpu")().shape == (256, 16)


def test_drjit_keeps_the_gradient_of_a_float16_mean():
    dr = pytest.importorskip("drjit")
    llvm = pytest.importorskip("drjit.llvm.ad")
    y = llvm.Float16(np.full(1 << 16, 0.5, np.float16))
    dr.enable_grad(y)
    loss = mean_square([y], [llvm.Float16(0.25)])
    dr.backward(peers_cuda.LOSS_SCALE * loss)
    assert loss.numpy()[0] == 0.0625
    np.testing.assert_allclose(dr.grad(y).numpy(), peers_cuda.LOSS_SCALE * 0.5 / (1 << 16), rtol=1e-3)

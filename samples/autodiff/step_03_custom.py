"""autodiff 3: a derivative of one's own, forwards and backwards.

    python -m samples.autodiff.step_03_custom

quantize(x) = round(4 x) / 4 is a staircase: its derivative is 0, and nothing learns through it. Training passes the
gradient straight through (Bengio et al. 2013, "Estimating or Propagating Gradients Through Stochastic Neurons"): the
derivative is said to be 1. Expect 0 without and 1 with the custom derivative, in both modes.
"""

import warp as wp

import warp_neural as wn
from warp_neural import cli
from warp_neural.samples.autodiff.lecture import backward, check, scalar


@wp.func
def staircase(x: float) -> float:
    return wp.round(4.0 * x) / 4.0


@wp.func
def quantize(x: float) -> float:
    return wp.round(4.0 * x) / 4.0


@wn.autodiff.forward_derivative(quantize)
@wp.func
def quantize_forward(x: float, dx: float):
    return quantize(x), dx


@wp.func_grad(quantize)
def quantize_backward(x: float, adj_ret: float):
    wp.adjoint[x] += adj_ret


@wp.func
def loss(x: float) -> float:
    return 3.0 * quantize(x)


@wp.kernel
def staircase_kernel(x: wp.array[float], result: wp.array[float]):
    result[0] = 3.0 * staircase(x[0])


@wp.kernel
def loss_kernel(x: wp.array[float], result: wp.array[float]):
    result[0] = loss(x[0])


def main(config: cli.CommonConfig) -> dict:
    device = cli.resolve_device(config.device)
    print("quantize(x) = round(4x) / 4 at 0.3;  L = 3 quantize(x)")
    metrics = {}
    value, metrics["automatic_forward"] = wn.autodiff.jvp(staircase, (0.3,), (1.0,), device=device)
    value, metrics["custom_forward"] = wn.autodiff.jvp(quantize, (0.3,), (1.0,), device=device)
    _, metrics["custom_forward_nested"] = wn.autodiff.jvp(loss, (0.3,), (1.0,), device=device)
    print(f"  fwd_diff(quantize)(diffPair(0.3, 1)) = ({value:g}, {metrics['automatic_forward']:g}) by rule")
    print(f"  [ForwardDerivative]: (quantize(x), dx) = ({value:g}, {metrics['custom_forward']:g})")
    print(f"  the chain rule goes on with it: fwd_diff(L) = 3 · 1 = {metrics['custom_forward_nested']:g}")

    for name, kernel in ("automatic", staircase_kernel), ("custom", loss_kernel):
        x = scalar(0.3, device)
        backward(kernel, [x], device)
        metrics[f"{name}_backward"] = x.grad.list()[0]
    print(f"  bwd_diff(L)(x, 1): x.d = {metrics['automatic_backward']:g} by rule")
    print(f"  [BackwardDerivative]: x.d = ∂L/∂quantize = {metrics['custom_backward']:g}")
    expected = {"automatic_forward": 0, "custom_forward": 1, "custom_forward_nested": 3}
    return check(metrics, expected | {"automatic_backward": 0, "custom_backward": 3})


if __name__ == "__main__":
    cli.run(main, cli.CommonConfig)

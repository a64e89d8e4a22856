"""autodiff 4: look at the gradients inside a function: print, record, stop at one that is not finite.

    python -m samples.autodiff.step_04_debug

debug_grad is the identity; its backward shows what passes. Expect 1 at y^2 in square(x, y) = x^2 + y^2, and an
infinite gradient found where a square root is taken of 0.
"""

import warp as wp

import warp_neural as wn
from warp_neural import cli
from warp_neural.samples.autodiff.lecture import backward, check, scalar

debug_grad = wn.autodiff.debug_grad


@wp.kernel
def print_kernel(x: wp.array[float], y: wp.array[float], result: wp.array[float]):
    result[0] = x[0] * x[0] + debug_grad(y[0] * y[0])


@wp.kernel
def record_kernel(x: wp.array[float], y: wp.array[float], record: wp.array[float], result: wp.array[float]):
    result[0] = x[0] * x[0] + debug_grad(y[0] * y[0], record, 0)


@wp.kernel
def root_kernel(x: wp.array[float], record: wp.array[float], result: wp.array[float]):
    i = wp.tid()
    wp.atomic_add(result, 0, wp.sqrt(debug_grad(x[i], record, i)))


def main(config: cli.CommonConfig) -> dict:
    device = cli.resolve_device(config.device)
    print("square(x, y) = x^2 + y^2 at (3, 4), debug_grad around y^2: ∂L/∂(y^2) = 1; in backward the device prints")
    backward(print_kernel, [scalar(3, device), scalar(4, device)], device)
    wp.synchronize_device(device)

    record = wp.zeros(1, dtype=float, device=device)
    y = scalar(4, device)
    backward(record_kernel, [scalar(3, device), y, record], device)
    metrics = {"debug_grad": record.list()[0], "debug_backward_y": y.grad.list()[0]}
    print(f"recorded: {metrics['debug_grad']:g}; and it goes on to y.d = 2y · 1 = {metrics['debug_backward_y']:g}")

    x = wp.array([4, 1, 0, 9], dtype=float, device=device, requires_grad=True)
    record = wp.zeros_like(x, requires_grad=False)
    backward(root_kernel, [x, record], device, len(x))
    print("L = Σ_i sqrt(x_i), x = (4, 1, 0, 9): ∂L/∂x_i = 1 / (2 sqrt(x_i))")
    try:
        wn.autodiff.check_finite(record)
        metrics["debug_found"] = ""
    except FloatingPointError as error:
        metrics["debug_found"] = str(error)
    print(f"  check_finite: {metrics['debug_found']}")
    expected = {"debug_grad": 1, "debug_backward_y": 8}
    return check(metrics, expected | {"debug_found": "gradient 2 is inf; 1 of 4 are not finite"})


if __name__ == "__main__":
    cli.run(main, cli.CommonConfig)

"""What the steps share: square, its gradient by a tape, and a check that a lesson comes out as it says."""

import warp as wp


@wp.func
def square(x: float, y: float) -> float:
    return x * x + y * y


def backward(kernel: wp.Kernel, inputs: list, device: wp.Device, dim: int = 1) -> float:
    """Launch `kernel(*inputs, result)`, send the gradient 1 back from `result[0]`; gradients reach the `inputs`."""
    result = wp.zeros(1, dtype=float, device=device, requires_grad=True)
    with wp.Tape() as tape:
        wp.launch(kernel, dim, inputs=inputs, outputs=[result], device=device)
    tape.backward(grads={result: wp.ones_like(result)})
    return float(result.numpy()[0])


def scalar(value: float, device: wp.Device) -> wp.array:
    """A differentiable array of one float."""
    return wp.array([value], dtype=float, device=device, requires_grad=True)


def check(metrics: dict, expected: dict) -> dict:
    """Return `metrics`; raises `ArithmeticError` for the first that is not exactly the `expected` one."""
    for name, value in expected.items():
        if metrics[name] != value:
            raise ArithmeticError(f"{name} is {metrics[name]}; expected {value}")
    return metrics

"""autodiff 2: backward mode, the gradient, of floats, of a struct, beside an integer, and of a buffer by index.

    python -m samples.autodiff.step_02_backward

Expect (6, 8) for square(x, y) = x^2 + y^2 at (3, 4), and 256 times 2 b_j for b_j^2 summed over 256 threads each.
"""

import warp as wp

from warp_neural import cli
from warp_neural.samples.autodiff.lecture import backward, check, scalar, square
from warp_neural.samples.autodiff.step_01_forward import Point, point, power, square_struct

THREADS = 1024


@wp.kernel
def square_kernel(x: wp.array[float], y: wp.array[float], result: wp.array[float]):
    result[0] = square(x[0], y[0])


@wp.kernel
def struct_kernel(p: wp.array[Point], result: wp.array[float]):
    result[0] = square_struct(p[0])


@wp.kernel
def power_kernel(x: wp.array[float], n: int, result: wp.array[float]):
    result[0] = power(x[0], n)


@wp.kernel
def buffer_kernel(buffer: wp.array[float], result: wp.array[float]):
    j = wp.tid() % len(buffer)  # an integer: it says where the gradient goes, and has none itself
    wp.atomic_add(result, 0, square(buffer[j], 0.0))


def main(config: cli.CommonConfig) -> dict:
    device = cli.resolve_device(config.device)
    x, y = scalar(3, device), scalar(4, device)
    backward(square_kernel, [x, y], device)
    metrics = {"backward_x": x.grad.list()[0], "backward_y": y.grad.list()[0]}
    print("square(x, y) = x^2 + y^2 at (3, 4)")
    print("backward: ∂L/∂x = ∂square/∂x ∂L/∂square = 2x · 1,  ∂L/∂y = 2y · 1")
    print(f"  bwd_diff(square)(x, y, 1): x.d = 2·3 = {metrics['backward_x']:g}, y.d = 2·4 = {metrics['backward_y']:g}")

    p = wp.array([point(3, 4)], dtype=Point, device=device, requires_grad=True)
    backward(struct_kernel, [p], device)
    gradient = p.grad.list()[0]
    metrics |= {"backward_struct_x": gradient.x, "backward_struct_y": gradient.y}
    print(f"the same with p = Point(3, 4): bwd_diff(square)(p, 1): p.d = ({gradient.x:g}, {gradient.y:g})")

    x = scalar(2, device)
    backward(power_kernel, [x, 3], device)
    metrics["backward_integer"] = x.grad.list()[0]
    print(f"power(x, n) = x^n at (2, 3): bwd_diff(power)(x, 3, 1): x.d = {metrics['backward_integer']:g}; n has none")

    buffer = wp.array([1, 2, 3, 4], dtype=float, device=device, requires_grad=True)
    backward(buffer_kernel, [buffer], device, THREADS)
    metrics["backward_buffer"] = buffer.grad.list()
    print(f"L = Σ_i b[i mod 4]^2 over {THREADS} threads, b = (1, 2, 3, 4): each adds its 2 b_j to b.d[j] atomically")
    print(f"  b.d[j] = {THREADS // 4} · 2 b_j = {metrics['backward_buffer']}")
    expected = {"backward_x": 6, "backward_y": 8, "backward_struct_x": 6, "backward_struct_y": 8}
    return check(metrics, expected | {"backward_integer": 12, "backward_buffer": [512, 1024, 1536, 2048]})


if __name__ == "__main__":
    cli.run(main, cli.CommonConfig)

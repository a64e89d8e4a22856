"""autodiff 1: forward mode, the derivative along a direction, of floats, of a struct, beside an integer.

    python -m samples.autodiff.step_01_forward

Expect 14 along (1, 1), 6 along (1, 0), 8 along (0, 1), for square(x, y) = x^2 + y^2 at (3, 4); 12 for x^3 at 2.
"""

import warp as wp

import warp_neural as wn
from warp_neural import cli
from warp_neural.samples.autodiff.lecture import check, square


@wp.struct
class Point:
    x: float
    y: float


def point(x: float, y: float) -> Point:
    p = Point()
    p.x, p.y = x, y
    return p


@wp.func
def square_struct(p: Point) -> float:
    return p.x * p.x + p.y * p.y


@wp.func
def power(x: float, n: int) -> float:
    return wp.pow(x, float(n))


@wp.func
def power_loop(x: float, n: int) -> float:
    y = float(1.0)
    for _ in range(n):
        y *= x
    return y


square_jvp = wn.autodiff.make_jvp(square)


@wp.kernel(enable_backward=False)
def forward_kernel(directions: wp.array[wp.vec2], derivatives: wp.array[float]):
    i = wp.tid()
    _value, derivative = square_jvp(3.0, 4.0, directions[i][0], directions[i][1])
    derivatives[i] = derivative


def main(config: cli.CommonConfig) -> dict:
    device = cli.resolve_device(config.device)
    print("square(x, y) = x^2 + y^2 at (3, 4)")
    print("forward: d square = ∂square/∂x dx + ∂square/∂y dy = 2x dx + 2y dy = 6 dx + 8 dy")
    directions = [(1, 1), (1, 0), (0, 1)]
    derivatives = wp.empty(len(directions), dtype=float, device=device)
    inputs = [wp.array(directions, dtype=wp.vec2, device=device)]
    wp.launch(forward_kernel, len(directions), inputs=inputs, outputs=[derivatives], device=device)
    metrics = {}
    for (dx, dy), derivative in zip(directions, derivatives.list(), strict=True):
        print(f"  fwd_diff(square)(diffPair(3, {dx}), diffPair(4, {dy})).d = 6·{dx} + 8·{dy} = {derivative:g}")
        metrics[f"forward_{dx}_{dy}"] = derivative

    p, dp = point(3, 4), point(1, 1)
    value, metrics["forward_struct"] = wn.autodiff.jvp(square_struct, (p,), (dp,), device=device)
    print("the same with p = Point(3, 4), dp = Point(1, 1)")
    print(f"  fwd_diff(square)(diffPair(p, dp)) = ({value:g}, 2 p.x dp.x + 2 p.y dp.y = {metrics['forward_struct']:g})")

    value, metrics["forward_integer"] = wn.autodiff.jvp(power, (2.0, 3), (1.0, None), device=device)
    print("power(x, n) = x^n at (2, 3); n is an integer and has no derivative")
    print(f"  fwd_diff(power)(diffPair(2, 1), 3) = ({value:g}, n x^(n - 1) dx = {metrics['forward_integer']:g})")
    _, metrics["forward_loop"] = wn.autodiff.jvp(power_loop, (2.0, 3), (1.0, None), device=device)
    print(f"the same as a loop of n products: {metrics['forward_loop']:g}")
    print("  (forward mode goes with the loop; Warp's backward mode keeps no values of a loop of unknown length: 42)")
    expected = {"forward_1_1": 14, "forward_1_0": 6, "forward_0_1": 8, "forward_struct": 14, "forward_integer": 12}
    return check(metrics, expected | {"forward_loop": 12})


if __name__ == "__main__":
    cli.run(main, cli.CommonConfig)

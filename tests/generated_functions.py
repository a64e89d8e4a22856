"""Random differentiable Warp functions as a source file: arithmetic, built-ins, calls, branches, loops, vectors."""

import numpy as np

HEAD = """import warp as wp

from warp_neural import autodiff

real, vec3 = wp.float64, wp.vec3d
"""

# {a} {b} {c} are scalars, {u} {v} vectors. All are defined everywhere and grow slowly.
SCALARS = [
    "({a} + {b})", "({a} - {b})", "{a} * {b}", "(-{a})", "{a} / (real(1.5) + {b} * {b})", "wp.sin({a})", "wp.cos({a})",
    "wp.tanh({a})", "wp.exp(wp.sin({a}))", "wp.log(real(1.2) + {a} * {a})", "wp.sqrt(real(1.1) + {a} * {a})",
    "wp.atan({a})", "wp.atan2({a}, real(1.0) + {b} * {b})", "wp.asin(wp.sin({a}) * real(0.9))", "wp.erf({a})",
    "wp.acos(wp.tanh({a}))", "wp.tan(wp.sin({a}))", "wp.sinh(wp.tanh({a}))", "wp.cosh(wp.sin({a}))",
    "wp.log2(real(2.0) + wp.sin({a}))", "wp.log10(real(2.0) + wp.cos({a}))", "wp.cbrt(real(3.0) + wp.sin({a}))",
    "wp.pow(real(1.5) + wp.sin({a}), {b})", "(real(2.0) + wp.cos({a})) ** real(-1.5)", "wp.abs({a})", "abs({a})",
    "wp.min({a}, {b})", "max({a}, {b})", "wp.clamp({a}, real(-0.5), {b} * {b})", "wp.lerp({a}, {b}, {c})",
    "wp.smoothstep(real(-0.8), real(1.3) + {b} * {b}, {a})", "wp.where({a} > {b}, {a}, {c})",
    "wp.degrees({a}) * real(0.01)", "wp.determinant(wp.outer({u}, {v}) + wp.diag({v}))",
    "({a} * {b} if {c} > real(0.1) else wp.sin({b}))", "{u}[1]", "{v}[2]", "wp.dot({u}, {v})", "wp.length({u})",
    "wp.length_sq({u})", "wp.max({u})", "wp.min({u})", "wp.float64(float(3)) * {a}",
    "wp.trace(wp.inverse(wp.diag(vec3(real(3.0))) + wp.skew({u})))",
]  # fmt: skip
VECTORS = [
    "({u} + {v})", "({u} - {v})", "{u} * {a}", "{u} / (real(2.0) + wp.sin({a}))", "wp.cross({u}, {v})", "(-{u})",
    "wp.normalize({u} + vec3(real(2.0)))", "wp.cw_mul({u}, {v})", "vec3({a}, real(0.5), {b})", "wp.abs({u})",
    "wp.min({u}, {v})", "wp.max({u}, {v})", "wp.lerp({u}, {v}, {a})", "wp.outer({u}, {v}) * {v}",
    "wp.transpose(wp.outer({u}, {v})) @ {u}", "wp.cw_div({u}, wp.cw_mul({v}, {v}) + vec3(real(1.0)))",
    "wp.where({a} > {b}, {u}, {v})", "wp.quat_rotate(wp.quatd({a}, {b}, real(0.2), {c}), {u})",
]  # fmt: skip


class Generator:
    def __init__(self, seed: int):
        self.rng = np.random.default_rng(seed)
        self.lines: list[str] = []

    def pick(self, choices):
        return choices[self.rng.integers(len(choices))]

    def fill(self, template: str) -> str:
        return template.format(
            a=self.pick(self.scalars), b=self.pick(self.scalars), c=self.pick(self.scalars),
            u=self.pick(self.vectors), v=self.pick(self.vectors),
        )  # fmt: skip

    def nested(self) -> str:
        """A scalar expression of scalar expressions."""
        names = {key: self.fill(self.pick(SCALARS)) for key in "abc"} | {key: self.pick(self.vectors) for key in "uv"}
        return self.pick(SCALARS).format(**names)

    def squashed(self, expression: str) -> str:
        return f"wp.tanh({expression}) * real({self.rng.uniform(0.5, 1.5):.3f})"

    def function(self, index: int) -> list[str]:
        self.scalars, self.vectors = ["x", "y"], ["v"]
        lines = [f"def f{index}(x: real, y: real, v: vec3, n: int) -> real:"]
        kinds = ["scalar", "vector", "branch", "loop", "component", "call"]
        kinds = [kinds[index % len(kinds)], *self.rng.choice(kinds, 2)]
        for step, kind in enumerate(kinds):
            name = f"s{step}"
            if kind == "vector":
                lines.append(f"    w{step} = {self.fill(self.pick(VECTORS))}")
                self.vectors.append(f"w{step}")
                continue
            lines.append(f"    {name} = {self.squashed(self.nested())}")
            if kind == "branch":
                lines += [f"    if {self.fill('{a} < {b}')}:", f"        {name} = {self.squashed(self.nested())}"]
                lines += ["    else:", f"        {name} += {self.fill(self.pick(SCALARS))}"] * self.rng.integers(2)
            elif kind == "loop":
                lines += [f"    for i in range({self.rng.integers(2, 5)}):"]
                lines += [f"        {name} = wp.sin({name} * {self.pick(self.scalars)} + real(i))"]
            elif kind == "component":
                # Not over a value that has a gradient: Warp's reverse mode would pass it on (see `overwrites`).
                lines += [f"    c{step} = vec3()", f"    c{step}[{step % 3}] = {name}"]
                lines += [f"    c{step}[1] += {self.pick(self.scalars)}"]
                self.vectors.append(f"c{step}")
            elif kind == "call" and index >= 6:
                callee = f"f{self.rng.integers(6)}"
                lines.append(f"    {name} = {name} * {callee}({self.fill('{a}, {b}, {u}')}, n) + real(n)")
            self.scalars.append(name)
        return [*lines, f"    return {self.scalars[-1]} + {self.nested()}", ""]


def generate(count: int, seed: int) -> str:
    """A module with `count` functions `(x, y, v, n) -> real`, and kernels of all their values and derivatives."""
    generator = Generator(seed)
    source = [HEAD]
    for index in range(count):
        source += ["", "@wp.func(inline=False)", *generator.function(index)]
    arguments = "p[0], p[1], vec3(p[2], p[3], p[4]), 3"
    source += ["", *(f"g{i} = autodiff.make_jvp(f{i})" for i in range(count)), ""]
    source += ["", "@wp.kernel", "def value_kernel(p: wp.array[real], values: wp.array[real]):"]
    source += [f"    values[{i}] = f{i}({arguments})" for i in range(count)]
    source += ["", "", "@wp.kernel(enable_backward=False)"]
    source += ["def jvp_kernel(p: wp.array[real], d: wp.array2d[real], y: wp.array2d[real], dy: wp.array2d[real]):"]
    source += ["    i = wp.tid()", "    e = vec3(d[i, 2], d[i, 3], d[i, 4])"]
    for i in range(count):
        source += [f"    y{i}, dy{i} = g{i}({arguments}, d[i, 0], d[i, 1], e)"]
        source += [f"    y[i, {i}] = y{i}", f"    dy[i, {i}] = dy{i}"]
    return "\n".join([*source, ""])

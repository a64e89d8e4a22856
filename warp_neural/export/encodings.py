"""Encodings as statements: what `kernels.nn.encodings` computes on the CPU, operation by operation."""

from functools import singledispatch

from warp_neural.errors import InputError
from warp_neural.export.statements import Block, For, Let, Set, Statement, Variable, number
from warp_neural.kernels.nn.encodings import (
    Concatenate,
    Encoding,
    Frequency,
    HashGrid,
    Identity,
    LatentTexture,
    OneBlob,
    Scaled,
    SphericalHarmonics,
    TriangleWave,
)
from warp_neural.kernels.nn.encodings.frequency import COSINE, SINE, horner
from warp_neural.kernels.nn.encodings.spherical_harmonics import polynomial

Values = tuple[str, ...]
"""expressions of the inputs"""


@singledispatch
def encode(encoding: Encoding, x: Values, out: int, start: int) -> list[Statement]:
    """Results to `h0[out]` and on. start: of its parameters in `weights`."""
    raise InputError(f"encoding {type(encoding).__name__} is not exported; give one of wn.encodings")


@encode.register
def _(encoding: Identity, x: Values, out: int, start: int) -> list[Statement]:
    return [Set(f"h0[{out + i}]", value) for i, value in enumerate(x)]


@encode.register
def _(encoding: Concatenate, x: Values, out: int, start: int) -> list[Statement]:
    statements = []
    for leaf in encoding.leaves(len(x)):
        inputs = tuple(x[i] for i in leaf.inputs)
        name = type(leaf.encoding).__name__
        statements.append(Block(name, tuple(encode(leaf.encoding, inputs, out + leaf.result, start + leaf.parameter))))
    return statements


@encode.register
def _(encoding: Scaled, x: Values, out: int, start: int) -> list[Statement]:
    inputs = tuple(f"({number(encoding.scale)} * {value} + {number(encoding.offset)})" for value in x)
    return encode(encoding.encoding, inputs, out, start)


@encode.register
def _(encoding: TriangleWave, x: Values, out: int, start: int) -> list[Statement]:
    statements = []
    for i, value in enumerate(x):
        for k in range(encoding.octaves):
            n = out + i * encoding.octaves + k
            turns, t = f"turns{n}", f"t{n}"
            statements.append(Let(turns, "float", f"{value} * {number(0.5 * 2**k)} + {number(0.25 * (k % 4))}"))
            statements.append(Let(t, "float", f"{turns} - floor({turns}) - 0.5f"))
            statements.append(Set(f"h0[{n}]", f"4.0f * abs({t}) - 1.0f"))
    return statements


@encode.register
def _(encoding: Frequency, x: Values, out: int, start: int) -> list[Statement]:
    statements = []
    for i, value in enumerate(x):
        for k, frequency in enumerate(encoding.frequencies()):
            n = out + 2 * (i * encoding.octaves + k)
            h, whole, r, s, flip = (f"{name}{n}" for name in ("h_", "whole", "r", "s", "flip"))
            statements += [
                Let(h, "float", f"{value} * {number(frequency)}"),
                Let(whole, "float", f"nearest({h})"),
                Let(r, "float", f"{h} - {whole}"),
                Let(s, "float", f"{r} * {r}"),
                Let(flip, "float", f"1.0f - 2.0f * abs({whole} - 2.0f * nearest(0.5f * {whole}))"),
                Set(f"h0[{n}]", f"{flip} * {r} * ({_horner(SINE, s)})"),
                Set(f"h0[{n + 1}]", f"{flip} * ({_horner(COSINE, s)})"),
            ]
    return statements


def _horner(coefficients: tuple[float, ...], s: str) -> str:
    return horner(coefficients).replace(" s ", f" {s} ")


@encode.register
def _(encoding: OneBlob, x: Values, out: int, start: int) -> list[Statement]:
    bins, statements = encoding.bins, []

    def cyclic(u: str) -> str:
        return f"quartic({u}) + quartic({u} - {number(bins)}) + quartic({u} + {number(bins)})"

    for i, value in enumerate(x):
        n = out + i * bins
        statements.append(Variable(f"edge{n}", "float", f"-{number(bins)} * {value}"))
        statements.append(Variable(f"below{n}", "float", cyclic(f"edge{n}")))
        for k in range(bins):
            statements.append(Set(f"edge{n}", f"{number(k + 1)} - {number(bins)} * {value}"))
            statements.append(Let(f"above{n + k}", "float", cyclic(f"edge{n}")))
            statements.append(Set(f"h0[{n + k}]", f"above{n + k} - below{n}"))
            statements.append(Set(f"below{n}", f"above{n + k}"))
    return statements


@encode.register
def _(encoding: SphericalHarmonics, x: Values, out: int, start: int) -> list[Statement]:
    names = zip(("x_", "y_", "z"), x, strict=True)
    statements: list[Statement] = [Let(name, "float", value) for name, value in names]
    statements += [Let("zz", "float", "z * z"), Let("c0", "float", "1.0f"), Let("s0", "float", "0.0f")]
    for m in range(1, encoding.degree):
        statements.append(Let(f"c{m}", "float", f"x_ * c{m - 1} - y_ * s{m - 1}"))
        statements.append(Let(f"s{m}", "float", f"x_ * s{m - 1} + y_ * c{m - 1}"))
    for index, m, polar in encoding.terms():
        statements.append(Set(f"h0[{out + index}]", f"{polynomial(polar)} * {'c' if m >= 0 else 's'}{abs(m)}"))
    return statements


@encode.register
def _(encoding: LatentTexture, x: Values, out: int, start: int) -> list[Statement]:
    n, channels = out, encoding.channels
    statements = [*_axis(encoding, f"u{n}", x[0], encoding.width), *_axis(encoding, f"v{n}", x[1], encoding.height)]
    statements += [Set(f"h0[{out + c}]", "0.0f") for c in range(channels)]
    for corner in range(4):
        i, j = corner % 2, corner // 2
        wx, wy = (f"offset_{a}{n}" if far else f"(1.0f - offset_{a}{n})" for a, far in (("u", i), ("v", j)))
        place = f"{start} + (v{n}_{j} * {encoding.width} + u{n}_{i}) * {channels}"
        at, weight = f"at{n}_{corner}", f"weight{n}_{corner}"
        statements += [Let(at, "int", place), Let(weight, "float", f"{wx} * {wy}")]
        for c in range(channels):
            statements.append(Set(f"h0[{out + c}]", f"h0[{out + c}] + {weight} * weights[{at} + {c}]"))
    return statements


def _axis(encoding: LatentTexture, name: str, value: str, size: int) -> list[Statement]:
    """`name`_0, `name`_1 and offset_`name`."""
    at, first, second, last = f"at_{name}", f"{name}_0", f"{name}_1", size - 1
    if not encoding.wrap:
        inside = f"pick({value} > 0.0f, min({value}, 1.0f) * {number(last)}, 0.0f)"
        return [
            Let(at, "float", inside),
            Let(first, "int", f"int({at})"),
            Let(second, "int", f"min({first} + 1, {last})"),
            Let(f"offset_{name}", "float", f"{at} - float({first})"),
        ]
    low = f"low_{name}"
    return [
        Let(at, "float", f"({value} - floor({value})) * {number(size)} - 0.5f"),
        Let(low, "float", f"floor({at})"),
        Let(first, "int", f"(int({low}) + {size}) % {size}"),
        Let(second, "int", f"({first} + 1) % {size}"),
        Let(f"offset_{name}", "float", f"{at} - {low}"),
    ]


@encode.register
def _(encoding: HashGrid, x: Values, out: int, start: int) -> list[Statement]:
    return [Block(f"level {level}", tuple(_level(encoding, level, x, out, start))) for level in range(encoding.levels)]


def _level(encoding: HashGrid, level: int, x: Values, out: int, start: int) -> list[Statement]:
    table, n = encoding.tables(len(x))[level], out + level * encoding.features
    statements: list[Statement] = []
    for a, value in enumerate(x):
        statements.append(Let(f"position{n}_{a}", "float", f"{value} * {number(table.scale)} + 0.5f"))
        statements.append(Let(f"whole{n}_{a}", "float", f"floor(position{n}_{a})"))
        statements.append(Let(f"offset{n}_{a}", "float", f"position{n}_{a} - whole{n}_{a}"))
        statements.append(Let(f"vertex{n}_{a}", "uint", f"uint(int(whole{n}_{a}))"))
    statements += [Set(f"h0[{n + c}]", "0.0f") for c in range(encoding.features)]
    corner, axes = f"corner{n}", range(len(x))
    bits = [f"(uint({corner}) >> {a}u & 1u)" for a in axes]
    weights = [f"pick({bits[a]} == 1u, offset{n}_{a}, 1.0f - offset{n}_{a})" for a in axes]
    terms = [f"(vertex{n}_{a} + {bits[a]}) * {table.factors[a]}u" for a in axes]
    index = (" ^ " if table.hashed else " + ").join(f"({term})" for term in terms)
    index = f"({index}) & {table.size - 1}u" if table.hashed else f"({index}) % {table.size}u"
    body: list[Statement] = [
        Let(f"weight{n}", "float", " * ".join(weights)),
        Let(f"at{n}", "uint", f"{start + table.start}u + ({index}) * {encoding.features}u"),
    ]
    for c in range(encoding.features):
        body.append(Set(f"h0[{n + c}]", f"h0[{n + c}] + weight{n} * weights[at{n} + {c}u]"))
    return [*statements, For(corner, 2 ** len(x), tuple(body))]

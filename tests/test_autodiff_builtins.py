"""Forward mode of every built-in function of Warp that takes floats: right, or refused by name; never constant."""

import collections
import re

import numpy as np
import warp as wp
import warp._src.context
import warp._src.types as types

import warp_neural as wn
from warp_neural.autodiff import make_jvp
from warp_neural.autodiff.source import define

real = wp.float64
TYPES = {
    "S": real, "V3": wp.vec3d, "V6": types.vector(6, real), "Q": wp.quatd, "T": wp.transformd, "M3": wp.mat33d,
    "M4": wp.mat44d,
}  # fmt: skip
FIELDS = {f"{kind}_{i}": type_ for kind, type_ in TYPES.items() for i in range(6 if kind in ("S", "V3") else 3)}
REFUSED = {
    "quat_from_matrix", "quat_rpy", "quat_slerp", "quat_to_axis_angle", "eig3", "qr3", "svd3", "noise", "pnoise",
    "curlnoise", "closest_point_edge_edge", "intersect_tri_tri", "poisson", "randf", "transform_set_rotation",
    "transform_set_translation", "transform_set_rotation_copy", "transform_set_translation_copy", "transformation",
    "quaternion", "matrix", "div_approx", "inverse_approx", "spatial_adjoint",
}  # fmt: skip
ROUND = ("int", "float", "float16", "float32", "bfloat16")  # no differences of these
SYMBOLS = {"add": "+", "sub": "-", "div": "/", "mod": "%"}
# Warp's own in Python, constructors, components, nested ones
OTHERS = [
    "wp.transform_compose(V3_0, Q_0, V3_1)", "wp.quatd(V3_0, S_0)", "wp.quatd(S_0, S_1, S_2, S_3)",
    "wp.transformd(V3_0, Q_0)", "wp.vec3d(S_0, S_1, S_0)", "wp.mat22d(S_0, S_1, S_2, S_3)", "wp.float64(S_0) * S_1",
    "wp.matrix_from_rows(V3_0, V3_1)", "wp.matrix_from_cols(V3_0, V3_1)", "-Q_0", "T_0.p", "T_0.q", "T_0[4]", "M3_0[1]",
    "M3_0[1, 2]", "Q_0[3]", "V3_0.z", "S_0 ** S_1", "M3_0 @ V3_0", "(T_0 * T_1) * T_2", "wp.copysign(S_0, -S_1)",
    "wp.transform_multiply(wp.transform_inverse(T_0), T_1)", "wp.length(Q_0 - Q_1)", "T_0 * wp.transformd(V3_0, Q_0)",
    "S_0 * S_1", "V3_0 * S_0", "M3_0 * V3_0", "V3_0 * M3_0", "Q_0 * Q_1", "S_0 // S_1",
]  # fmt: skip


def kind_of(type_):
    """Of an argument: a key of TYPES, where any size goes that with 3; B, I; None for everything else."""
    if isinstance(type_, str) or types.is_array(type_) or types.is_tile(type_):
        return None
    if type_ in (wp.bool, wp.int32, wp.uint32):
        return "B" if type_ is wp.bool else "I"
    floats = (types.Float, types.Scalar, types.Any, real, wp.float32)
    hints = {types.Vector: "V", types.Matrix: "M", types.Quaternion: "Q", types.Transformation: "T"}
    name = hints.get(getattr(type_, "_wp_generic_type_hint_", None))
    if name is None or type_._wp_scalar_type_ not in floats:
        return "S" if type_ in floats else None
    kind = name + str(type_._shape_[0] or 3) if name in "VM" else name
    return kind if kind in TYPES else None


def expressions():
    """Expression -> name, of every built-in function for every kind of its arguments."""
    found = {}
    for name, function in sorted(warp._src.context.builtin_functions.items()):
        for overload in getattr(function, "overloads", []):
            wanted = overload.group.endswith(("Math", "Operators", "Geometry", "Random", "Transformations"))
            arguments = {key: kind_of(type_) for key, type_ in overload.input_types.items() if key != "dtype"}
            kinds = tuple(arguments.values())
            if not (wanted or name in ("lerp", "smoothstep", "where", "copy")) or not set(kinds) & set(TYPES):
                continue
            if None in kinds or any(key.startswith("*") for key in arguments) or name in ROUND:
                continue
            if name in ("mul", "div") and "I" in kinds:  # vectors of integers
                continue
            used, texts = collections.Counter(), []
            for kind in kinds:
                texts.append({"B": "S_0 > S_1", "I": "2"}.get(kind, f"{kind}_{used[kind]}"))
                used[kind] += 1
            call = f"wp.{name}({', '.join(texts)})"
            found[f"{texts[0]} {SYMBOLS[name]} {texts[1]}" if name in SYMBOLS else call] = name
    other_size = {e.replace("V3", "V6").replace("M3", "M4") for e in found if "V3" in e or "M3" in e}
    return {expression: name for expression, name in found.items() if expression not in other_size}


def arguments_of(expression):
    return [name for name in FIELDS if re.search(rf"\b{name}\b", expression)]


def function_of(expression):
    names = arguments_of(expression)
    source = f"def f({', '.join(names)}):\n    return {expression}\n"
    types = {name: FIELDS[name] for name in names}
    return wp.func(define(source, "f", {"wp": wp, "__name__": __name__}, types), module="unique")


def is_tested(function):
    """Whether Warp takes the arguments and returns one value of floats."""
    try:
        function.build(None)
        result = function.value_func(function.input_types, None)
    except Exception:
        return False
    result = result[0] if isinstance(result, (list, tuple)) and len(result) == 1 else result
    return types.type_is_float(getattr(result, "_wp_scalar_type_", result))


@wp.func
def total(x: real):
    return x


@wp.func
def total(x: types.vector(length=types.Any, dtype=types.Float)):
    result = real(0.0)
    for i in range(len(x)):
        result += x[i] * real(1 + i)
    return result


@wp.func
def total(x: types.matrix(shape=(types.Any, types.Any), dtype=types.Float)):
    result = real(0.0)
    for i in range(len(x)):
        result += total(x[i]) * real(1 + i)
    return result


@wp.func
def total(x: wp.quatd):
    return x[0] + real(2.0) * x[1] + real(3.0) * x[2] + real(4.0) * x[3]


@wp.func
def total(x: wp.transformd):
    return total(x.p) + total(x.q) * real(5.0)


def make_point():
    """A struct of FIELDS, from a text, for they are many."""
    namespace = {"FIELDS": FIELDS, "__name__": __name__}
    exec("class Point:\n" + "\n".join(f"    {name}: FIELDS['{name}']" for name in FIELDS), namespace)
    return wp.struct(namespace["Point"])


Point = make_point()


def evaluate(functions, line, points, directions, device):
    """[points, functions]: what `line` stores of each function of `functions`, by expression."""
    head = "def kernel(points, directions, results):\n    n = wp.tid()\n    p, d = points[n], directions[n]\n"
    columns = []
    for start in range(0, len(functions), 32):
        some = dict(list(functions.items())[start : start + 32])
        text, namespace = head, {"wp": wp, "total": total, "__name__": __name__}
        for i, (expression, function) in enumerate(some.items()):
            namespace[f"f{i}"] = function
            values, tangents = (", ".join(f"{x}.{name}" for name in arguments_of(expression)) for x in "pd")
            text += "    " + line.format(i=i, values=values, tangents=tangents) + "\n"
        types = {"points": wp.array[Point], "directions": wp.array[Point], "results": wp.array2d[real]}
        options = {"optimization_level": 0 if device.is_cpu else 1}
        kernel = wp.kernel(
            define(text, "kernel", namespace, types), module="unique", module_options=options, enable_backward=False
        )
        rows = [x.view(Point.numpy_dtype())[:, 0] for x in (points, directions)]
        inputs = [wp.array(row, dtype=Point, device=device) for row in rows]
        results = wp.zeros((len(points), len(some)), dtype=real, device=device)
        wp.launch(kernel, len(points), inputs=inputs, outputs=[results], device=device)
        columns.append(results.numpy())
    return np.hstack(columns)


def test_every_built_in_function_is_right(device):
    cases = [e for e, name in expressions().items() if name not in REFUSED] + OTHERS
    functions = {expression: function_of(expression) for expression in cases}
    functions = {expression: function for expression, function in functions.items() if is_tested(function)}
    assert set(OTHERS) <= set(functions) and len(functions) > 150
    rng, step = np.random.default_rng(0), 1e-5
    size = sum(getattr(type_, "_length_", 1) for type_ in FIELDS.values())
    points, directions = rng.uniform(0.25, 0.75, (3, size)), rng.uniform(-1, 1, (3, size))
    value = "results[n, {i}] = total(f{i}({values}))"
    ahead, behind = (
        evaluate(functions, value, points + sign * step * directions, directions, device) for sign in (1, -1)
    )
    tangent = "y{i}, t{i} = f{i}({values}, {tangents}); results[n, {i}] = total(t{i})"
    derivatives = {expression: make_jvp(function) for expression, function in functions.items()}
    computed = evaluate(derivatives, tangent, points, directions, device)
    differences = (ahead - behind) / (2 * step)
    wrong = np.abs(computed - differences) > 1e-6 * (1 + np.abs(differences))  # inverses bend the most
    names = list(functions)
    assert not wrong.any(), {names[i]: (computed[:, i], differences[:, i]) for i in np.nonzero(wrong.any(axis=0))[0]}


def test_the_rest_is_refused_by_name():
    refused = set()
    for expression, name in expressions().items():
        try:
            make_jvp(function_of(expression))
        except wn.InputError as error:
            assert f"wp.{name}" in str(error)
            refused.add(name)
    assert refused == REFUSED

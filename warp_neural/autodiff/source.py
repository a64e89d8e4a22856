"""Read the source of a `@wp.func`, what in it depends on which arguments, and make functions from source."""

import ast
import inspect
import itertools
import linecache
import types
from collections.abc import Callable
from typing import Any

import warp as wp

from warp_neural.kernels.autodiff.rules import CONSTANT

NUMBERS = itertools.count()


def differentiable(type_: Any) -> bool:
    """Floats, their vectors, matrices and quaternions, structs that hold one, and generic types have tangents."""
    if wp.types.type_is_struct(type_):
        return any(differentiable(variable.type) for variable in type_.vars.values())
    if wp.types.is_array(type_):
        return False
    scalar = getattr(type_, "_wp_scalar_type_", type_)
    return scalar is Any or scalar is wp.Float or wp.types.type_is_float(scalar)


def root(node: ast.expr) -> str:
    """The variable that `v`, `v[i]` or `v.x[i]` is or is part of."""
    while isinstance(node, (ast.Attribute, ast.Subscript)):
        node = node.value
    return node.id


def execute(source: str, namespace: dict[str, Any]) -> None:
    """Run a source text; Warp finds it through `linecache`, under a name that no other text ever has."""
    file = f"<{__name__} {next(NUMBERS)}>"
    linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)
    exec(compile(source, file, "exec"), namespace)


def define(source: str, name: str, namespace: dict[str, Any], annotations: dict[str, Any]) -> Callable:
    """The function `name` of a source text."""
    execute(source, namespace)
    namespace[name].__annotations__ = annotations
    return namespace[name]


class Source:
    """The source of `func`: what its names mean, and which of its variables are active.

    A variable is active if it ever gets a value that depends on an active argument. Of types only those of arguments,
    structs and their fields are known.
    """

    def __init__(self, func: wp.Function, active: tuple[bool, ...]):
        self.tree = ast.parse(func.adj.source).body[0]  # what Warp read when it was decorated
        self.namespace = func.func.__globals__ | inspect.getclosurevars(func.func).nonlocals
        self.types = dict(func.input_types)
        self.active = {name for name, is_active in zip(func.input_types, active, strict=True) if is_active}
        pairs = self._assignments()
        for target, value in pairs:
            known = self.type_of(value)
            if isinstance(target, ast.Name) and known is not None:
                self.types.setdefault(target.id, known)
        before = -1
        while len(self.active) != before:
            before = len(self.active)
            for target, value in pairs:
                if self.is_active(value) and differentiable(self.types.get(root(target), Any)):
                    self.active.add(root(target))

    def _assignments(self) -> list[tuple[ast.expr, ast.expr]]:
        """Every target with the expression that it gets its value from."""
        pairs = []
        for node in ast.walk(self.tree):
            if isinstance(node, (ast.Assign, ast.AnnAssign, ast.AugAssign)) and node.value is not None:
                target = node.targets[0] if isinstance(node, ast.Assign) else node.target
                targets = target.elts if isinstance(target, ast.Tuple) else [target]
                values = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value] * len(targets)
                pairs += zip(targets, values, strict=True)
        return pairs

    def type_of(self, node: ast.expr) -> Any:
        """None where it takes more than a look."""
        if isinstance(node, ast.Name):
            return self.types.get(node.id)
        if isinstance(node, ast.Attribute):
            struct = self.type_of(node.value)
            return struct.vars[node.attr].type if wp.types.type_is_struct(struct) else None
        if isinstance(node, ast.Call):
            callee = self.resolve(node.func)
            if wp.types.type_is_struct(callee):
                return callee
            if isinstance(callee, wp.Function) and not callee.is_builtin():
                return callee.func.__annotations__.get("return")
        return None

    def may_be_transform(self, node: ast.expr) -> bool:
        if isinstance(node, ast.Constant):
            return False
        known = self.type_of(node)
        return known is None or wp.types.type_is_transformation(known)

    def is_active(self, node: ast.AST) -> bool:
        match node:
            case ast.Name():
                return node.id in self.active
            case ast.Attribute():
                known = self.type_of(node)
                return self.is_active(node.value) and (known is None or differentiable(known))
            case ast.Subscript():
                return self.is_active(node.value)
            case ast.IfExp():
                return self.is_active(node.body) or self.is_active(node.orelse)
            case ast.Compare() | ast.BoolOp() | ast.UnaryOp(op=ast.Not()) | ast.BinOp(op=ast.FloorDiv()):
                return False
            case ast.Call():
                constant = self.resolve(node.func) in CONSTANT
                return not constant and any(map(self.is_active, node.args + [k.value for k in node.keywords]))
        return any(map(self.is_active, ast.iter_child_nodes(node)))

    def resolve(self, node: ast.expr) -> Any:
        """The function or type that an expression names; None for a local one."""
        try:
            found = eval(ast.unparse(node), self.namespace)
        except (NameError, AttributeError):
            found = getattr(wp, node.id, None) if isinstance(node, ast.Name) else None
        if isinstance(found, types.BuiltinFunctionType):
            found = getattr(wp, found.__name__, found)  # Python's abs, min, max
        return found

    def count_results(self) -> int:
        """How many values the function returns."""
        returned = [n.value for n in ast.walk(self.tree) if isinstance(n, ast.Return) and n.value is not None]
        if not returned:
            return 0
        return len(returned[0].elts) if isinstance(returned[0], ast.Tuple) else self.results_of(returned[0])

    def results_of(self, node: ast.expr) -> int:
        """How many values an expression has: more than one only for calls."""
        callee = self.resolve(node.func) if isinstance(node, ast.Call) else None
        if not isinstance(callee, wp.Function) or callee.is_builtin() or callee.native_snippet is not None:
            return 1
        return Source(callee, (False,) * len(callee.input_types)).count_results()

"""Forward mode: rewrites the source of a `@wp.func` so that every value carries its tangent.

`y = f(a * b)` becomes steps of one operation, each a value and a tangent (Griewank and Walther, Evaluating Derivatives,
2008, chapter 3):

    t__0 = a * b
    t__0__dot = a__dot * b + a * b__dot
    t__1, t__1__dot = f__1(t__0, t__0__dot)
    y = t__1
    y__dot = t__1__dot

Control flow stays as it is. What does not depend on an active argument is left alone and has no tangent.
"""

import ast
import inspect
from collections.abc import Callable
from functools import cache

import warp as wp

from warp_neural.autodiff.dual import REMEDY, Dual, Expressions
from warp_neural.autodiff.source import define, differentiable
from warp_neural.errors import InputError
from warp_neural.kernels.autodiff.transform_rules import RULES

HARMLESS = ("print", "expect_", "atomic_", "breakpoint", "store")
"""Names of built-in functions, or their beginnings, that are called for their effect and change no variable."""
WRITES = "writes to its arguments, which forward mode does not follow"


@cache
def make_forward(func: wp.Function, active: tuple[bool, ...]) -> wp.Function:
    """`(arguments, tangents of the active ones) -> (results, their tangents)`, for all overloads of `func`."""
    if func.native_snippet is not None:
        raise InputError(f"jvp of {func.key}: native code has no forward derivative; {REMEDY}")
    overloads = [*func.user_overloads.values(), *func.user_templates.values()]
    overloads = [f for f in overloads if f.generic_parent is None and len(f.input_types) == len(active)]
    inline = None if func.inline_hint is None else func.inline_hint == "forceinline"
    make = wp.func(module="unique", inline=inline)
    first, *others = [make(_Rewriter(overload, active).function()) for overload in overloads]
    for other in others:
        first.add_overload(other)
    return first


class _Rewriter(Expressions):
    def function(self) -> Callable:
        arguments = self.func.input_types
        tangents = {self._dot(name): arguments[name] for name in arguments if name in self.source.active}
        for statement in self.source.tree.body:
            self._statement(statement)
        annotations = arguments | tangents
        name = f"{self.func.func.__name__}_jvp"
        source = "\n".join([f"def {name}({', '.join(annotations)}):", *self.lines, ""])
        return define(source, name, self.namespace, annotations)

    def _statement(self, node: ast.stmt) -> None:
        match node:
            case ast.Expr(value=ast.Constant()):  # the docstring
                pass
            case ast.Assign(targets=[target], value=value):
                self._assign(node, target, value)
            case ast.AnnAssign(target=target, value=value) if value is not None:
                self._assign(node, target, value)
            case ast.AugAssign(target=target, op=op, value=value):
                self._assign(node, target, ast.BinOp(target, op, value))
            case ast.If():
                self._block(f"if {ast.unparse(node.test)}:", node.body)
                if node.orelse:
                    self._block("else:", node.orelse)
            case ast.For():
                self._block(f"for {ast.unparse(node.target)} in {ast.unparse(node.iter)}:", node.body)
            case ast.While():
                self._block(f"while {ast.unparse(node.test)}:", node.body)
            case ast.Return(value=value) if value is not None:
                self._return(value)
            case ast.Expr(value=ast.Call()):
                self._effect(node)
            case _:
                self._emit(ast.unparse(node))

    def _effect(self, node: ast.Expr) -> None:
        """A call for what it does: prints and writes to arrays stay, what writes to variables loses their tangents."""
        callee = self.source.resolve(node.value.func)
        harmless = callee is print or (
            isinstance(callee, wp.Function)
            and (callee.key.startswith(HARMLESS) if callee.is_builtin() else not _writes(callee))
        )
        if not harmless and any(map(self.source.is_active, node.value.args)):
            raise self._error(node, f"{ast.unparse(node.value.func)} {WRITES}")
        self._emit(ast.unparse(node))

    def _block(self, head: str, body: list[ast.stmt]) -> None:
        self._emit(head)
        self.depth += 1
        for statement in body:
            self._statement(statement)
        self.depth -= 1

    def _assign(self, node: ast.stmt, target: ast.expr, value: ast.expr) -> None:
        targets = target.elts if isinstance(target, ast.Tuple) else [target]
        if not any(map(self.source.is_active, targets)):
            self._emit(ast.unparse(node))
            return
        if isinstance(value, ast.Tuple):
            duals = [self._step(*self._dual(v)) for v in value.elts]  # all, before any target changes
        else:
            duals = [self._dual(value)] if len(targets) == 1 else self._call(value, len(targets))
        for one, (text, tangent) in zip(targets, duals, strict=True):
            name, name_dot = self._dual(one) if self.source.is_active(one) else (ast.unparse(one), None)
            self._emit(f"{name} = {text}")
            if name_dot is not None:
                self._emit(f"{name_dot} = {tangent or self._zero(text)}")

    def _return(self, value: ast.expr) -> None:
        if isinstance(value, ast.Tuple):
            duals = [self._dual(v) for v in value.elts]
        else:
            count = self.source.results_of(value)
            duals = [self._dual(value)] if count == 1 else self._call(value, count)
        tangents = [tangent or self._zero(value) for value, tangent in duals]
        self._emit(f"return {', '.join([value for value, _ in duals] + tangents)}")

    def _call_user(self, callee: wp.Function, node: ast.Call, count: int) -> list[Dual]:
        if _writes(callee):
            raise self._error(node, f"{callee.key} {WRITES}")
        bound = inspect.signature(callee.func).bind(*node.args, **{k.arg: k.value for k in node.keywords})
        duals = {name: self._dual(argument) for name, argument in bound.arguments.items()}
        for name, default in callee.defaults.items():
            duals.setdefault(name, (self._name_for(default, "default"), None))
        duals = [duals[name] for name in callee.input_types]
        if callee not in RULES:
            return self._apply(make_forward(callee, tuple(d is not None for _, d in duals)), duals, count)
        takes = [differentiable(type_) for type_ in callee.input_types.values()]
        duals = [(v, d or self._zero(v)) if take else (v, None) for take, (v, d) in zip(takes, duals, strict=True)]
        return self._apply(RULES[callee], duals, count)


def _writes(func: wp.Function) -> bool:
    """Whether a function changes variables of its caller."""
    return any(type(type_) is type(wp.ref[float]) for type_ in func.input_types.values())

"""Expressions in forward mode: each becomes steps of one operation, a value and its tangent."""

import ast
import operator
from typing import Any, TypeVar

import warp as wp

from warp_neural.autodiff.source import Source
from warp_neural.errors import InputError
from warp_neural.kernels.autodiff.rules import LINEAR, PRODUCTS, zero
from warp_neural.kernels.autodiff.transform_rules import RULES, left_of_product, right_of_product

Dual = tuple[str, str | None]
"""Source text of a value and of its tangent; None for a value that depends on no active argument."""

REMEDY = "register a forward derivative with @wn.autodiff.forward_derivative"
OPERATORS = {ast.Div: operator.truediv, ast.Mod: operator.mod, ast.Pow: operator.pow}


class Expressions:
    """Writes `lines` of source, in which expressions of `func` are taken apart."""

    def __init__(self, func: wp.Function, active: tuple[bool, ...]):
        self.func = func
        self.source = Source(func, active)
        self.mark = "__"  # in every name that is added, in none that is there: what is rewritten may be rewritten again
        while self.mark in ast.unparse(self.source.tree):
            self.mark += "_"
        self.namespace = dict(self.source.namespace)
        self.lines: list[str] = []
        self.depth = 1
        self.steps = 0

    def _error(self, node: ast.AST, message: str) -> InputError:
        return InputError(f"jvp of {self.func.key}: `{ast.unparse(node)}`: {message}")

    def _emit(self, line: str) -> None:
        self.lines.append("    " * self.depth + line)

    def _names(self, count: int) -> list[str]:
        self.steps += count
        return [f"t{self.mark}{i}" for i in range(self.steps - count, self.steps)]

    def _step(self, value: str, tangent: str | None = None) -> Dual:
        (name,) = self._names(1)
        self._emit(f"{name} = {value}")
        if tangent is not None:
            self._emit(f"{self._dot(name)} = {tangent}")
        return name, None if tangent is None else self._dot(name)

    def _atom(self, node: ast.expr) -> str:
        """Text of an inactive expression that may be repeated."""
        part = node.operand if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) else node
        while isinstance(part, ast.Attribute):
            part = part.value
        plain = isinstance(part, (ast.Name, ast.Constant, ast.Slice))
        return ast.unparse(node) if plain else self._step(ast.unparse(node))[0]

    def _dual(self, node: ast.expr) -> Dual:
        if not self.source.is_active(node):
            return self._atom(node), None
        match node:
            case ast.Name(id=name):
                return name, self._dot(name)
            case ast.Attribute():
                value, tangent = self._dual(node.value)
                return f"{value}.{node.attr}", f"{tangent}.{node.attr}"
            case ast.Subscript():
                value, tangent = self._dual(node.value)
                parts = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
                index = ", ".join(map(self._atom, parts))
                return f"{value}[{index}]", f"{tangent}[{index}]"
            case ast.UnaryOp(op=ast.USub()):
                value, tangent = self._dual(node.operand)
                return self._step(f"-{value}", f"-{tangent}")
            case ast.UnaryOp(op=ast.UAdd()):
                return self._dual(node.operand)
            case ast.BinOp():
                return self._binary(node)
            case ast.IfExp():
                return self._choice(node)
            case ast.Call():
                return self._call(node, 1)[0]
        raise self._error(node, "not supported in forward mode")

    def _binary(self, node: ast.BinOp) -> Dual:
        (a, da), (b, db) = self._dual(node.left), self._dual(node.right)
        match node.op:
            case ast.Add():
                return self._step(f"{a} + {b}", " + ".join(filter(None, (da, db))))
            case ast.Sub():
                return self._step(f"{a} - {b}", (da or "") + (f" - {db}" if db else ""))
            case ast.Mult() | ast.MatMult():
                left, right = f"{da} * {b}", f"{a} * {db}"
                if self.source.may_be_transform(node.left) and self.source.may_be_transform(node.right):
                    a = self._local(a)
                    left = f"{self._name_for(left_of_product, 'left')}({a}, {b}, {da})"
                    right = f"{self._name_for(right_of_product, 'right')}({a}, {b}, {db})"
                return self._step(f"{a} * {b}", " + ".join([left] * bool(da) + [right] * bool(db)))
        if type(node.op) not in OPERATORS:
            raise self._error(node, "not supported in forward mode")
        return self._apply(RULES[OPERATORS[type(node.op)]], [(a, da or self._zero(a)), (b, db or self._zero(b))], 1)[0]

    def _choice(self, node: ast.IfExp) -> Dual:
        (name,) = self._names(1)
        for head, branch in (f"if {ast.unparse(node.test)}:", node.body), ("else:", node.orelse):
            self._emit(head)
            self.depth += 1
            value, tangent = self._dual(branch)
            self._emit(f"{name} = {value}")
            self._emit(f"{self._dot(name)} = {tangent or self._zero(value)}")
            self.depth -= 1
        return name, self._dot(name)

    def _call(self, node: ast.Call, count: int) -> list[Dual]:
        """The `count` results of a call."""
        if not self.source.is_active(node):
            names = self._names(count)
            self._emit(f"{', '.join(names)} = {ast.unparse(node)}")
            return [(name, None) for name in names]
        callee = self.source.resolve(node.func)
        text = ast.unparse(node.func)
        if isinstance(callee, wp.Function) and not callee.is_builtin():
            return self._call_user(callee, node, count)
        if callee is wp.mul and len(node.args) == 2:
            return [self._binary(ast.BinOp(node.args[0], ast.Mult(), node.args[1]))]
        duals = [self._dual(argument) for argument in node.args]
        if callee is wp.where:
            duals[0] = duals[0][0], "False"  # also of an array
        if callee in RULES and not node.keywords:
            return self._apply(
                RULES[callee], [(value, tangent or self._zero(value)) for value, tangent in duals], count
            )
        keywords = [ast.unparse(keyword) for keyword in node.keywords if not self.source.is_active(keyword.value)]
        values = [value for value, _ in duals]
        value = f"{text}({', '.join(values + keywords)})"
        is_type = isinstance(callee, type) or isinstance(node.func, ast.Call) or text.endswith(".dtype")
        if callee in PRODUCTS and not node.keywords:
            sides = [[*values[:i], tangent, *values[i + 1 :]] for i, (_, tangent) in enumerate(duals) if tangent]
            return [self._step(value, " + ".join(f"{text}({', '.join(side)})" for side in sides))]
        if len(keywords) == len(node.keywords) and (callee in LINEAR or is_type):
            tangents = [tangent or self._zero(value) for value, tangent in duals]
            return [self._step(value, f"{text}({', '.join(tangents + keywords)})")]
        raise self._error(node, f"no forward derivative of {text} is known; {REMEDY}")

    def _apply(self, rule: wp.Function, duals: list[Dual], count: int) -> list[Dual]:
        """Call a function of `(arguments, tangents)` that returns `(results, tangents)`."""
        names = self._names(count)
        tangents = [self._dot(name) for name in names]
        arguments = [value for value, _ in duals] + [tangent for _, tangent in duals if tangent]
        arguments[0] = self._local(arguments[0])
        function = self._name_for(rule, rule.func.__name__)
        self._emit(f"{', '.join(names + tangents)} = {function}({', '.join(arguments)})")
        return list(zip(names, tangents, strict=True))

    def _name_for(self, value: Any, name: str) -> str:
        """A name for a function or constant in the rewritten source."""
        name = f"{name}{self.mark}{len(self.namespace)}"
        self.namespace[name] = value
        return name

    def _dot(self, name: str) -> str:
        return f"{name}{self.mark}dot"

    def _zero(self, value: str) -> str:
        """A zero of the type of a value: a literal for a literal."""
        try:
            return repr(type(ast.literal_eval(value))())
        except ValueError:
            name = f"zero{self.mark}"
            self.namespace[name] = zero
            return f"{name}({self._local(value)})"

    def _local(self, value: str) -> str:
        """For calls: Warp 1.19 fails where all arguments are parameters of the caller and one has a `TypeVar` type."""
        return self._step(value)[0] if any(isinstance(t, TypeVar) for t in self.func.input_types.values()) else value

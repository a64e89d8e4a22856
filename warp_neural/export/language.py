"""Statements as text: what languages like C have in common; each overrides what it writes otherwise."""

from warp_neural.export.statements import Array, Block, For, Let, Set, Statement, Variable

INDENT = "    "


class Language:
    """Of C."""

    def lines(self, statements: tuple[Statement, ...], depth: int = 1) -> str:
        return "".join(self.line(each, depth) for each in statements)

    def line(self, each: Statement, depth: int) -> str:
        indent = depth * INDENT
        match each:
            case Let(name, type, value):
                return f"{indent}{self.constant(name, type, value)}\n"
            case Variable(name, type, value):
                return f"{indent}{self.variable(name, type, value)}\n"
            case Array(name, size):
                return f"{indent}{self.array(name, size)}\n"
            case Set(target, value):
                return f"{indent}{self.set(target, value)}\n"
            case For(name, count, body):
                return f"{indent}{self.loop(name, count)} {{\n{self.lines(body, depth + 1)}{indent}}}\n"
            case Block(note, body):
                return f"{indent}{{  // {note}\n{self.lines(body, depth + 1)}{indent}}}\n"
        raise TypeError(each)

    def constant(self, name: str, type: str, value: str) -> str:
        return f"const {type} {name} = {value};"

    def variable(self, name: str, type: str, value: str) -> str:
        return f"{type} {name} = {value};"

    def array(self, name: str, size: int) -> str:
        return f"float {name}[{size}];"

    def set(self, target: str, value: str) -> str:
        return f"{target} = {value};"

    def loop(self, name: str, count: int) -> str:
        return f"for (int {name} = 0; {name} < {count}; ++{name})"

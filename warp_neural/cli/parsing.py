"""The command line: how the program was called, its options, completion in shells."""

import io
import shlex
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any, TextIO

import tyro

from warp_neural.errors import InputError

PATCHES = {  # of what tyro writes for shells: where it has nothing to offer, names of files are
    "complete -F ": "complete -o default -F ",
    " completion_array\n}": " completion_array || _files\n}",
}


def program() -> str:
    """As it was called: `python -m samples.mipmap`, or `warp-neural`."""
    spec = getattr(sys.modules["__main__"], "__spec__", None)
    return f"python -m {spec.name.removesuffix('.__main__')}" if spec else Path(sys.argv[0]).name


def again(option: str) -> str:
    """The same command with another option."""
    arguments = sys.argv[1:]
    return " ".join([program(), shlex.join(arguments + [option] * (option not in arguments))])


def parse(config_class: type, args: list[str] | None, prog: str | None = None) -> Any:
    """A `config_class` from the command line, or from `args`; `SystemExit` after help, completion and bad options."""
    args = sys.argv[1:] if args is None else args
    output, errors = _page(sys.stdout), _page(sys.stderr)
    try:
        with redirect_stdout(output), redirect_stderr(errors):
            return tyro.cli(config_class, args=args, prog=prog or program())
    except SystemExit as ended:
        refused = ended.__context__
        while refused is not None and not isinstance(refused, InputError):
            refused = refused.__context__
        if refused:
            raise refused from None  # in its own words, where tyro draws a box around them
        print(_completing(_read(output)), end="")
        print(_read(errors), end="", file=sys.stderr)
        raise


def _page(stream: TextIO | None) -> io.TextIOWrapper:
    """Of the same encoding: it decides whether boxes are drawn."""
    return io.TextIOWrapper(io.BytesIO(), getattr(stream, "encoding", None) or "ascii", errors="replace", newline="")


def _read(page: io.TextIOWrapper) -> str:
    page.seek(0)
    return page.read()


def _completing(text: str) -> str:
    for old, new in PATCHES.items():
        text = text.replace(old, new)
    return text

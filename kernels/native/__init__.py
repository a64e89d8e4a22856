"""Native text: C++ and CUDA that `wp.func_native` takes, from files and from Python."""

from functools import cache
from pathlib import Path


def both(cpu_text: str, cuda_text: str) -> str:
    """One text for the two compilers."""
    return f"#if defined(__CUDA_ARCH__)\n{cuda_text}\n#else\n{cpu_text}\n#endif\n"


def paste(file: Path, **constants: int | float) -> str:
    """The text of a native file, after lines that define the constants that its first comment asks for.

    Pasted and not included, so that Warp's hash of a module covers it. No templates: a snippet is inside a function.
    """
    return "".join(constant(*item) for item in constants.items()) + read(file)


def constant(name: str, value: int | float) -> str:
    return f"constexpr int {name} = {value:d};\n" if isinstance(value, int) else f"constexpr float {name} = {value}f;\n"


@cache
def read(file: Path) -> str:
    return file.read_text(encoding="utf-8")


ATOMICS = paste(Path(__file__).with_name("atomics.cuh"))


def unroll(text: str) -> str:
    """Text in which `UNROLL for (...)` is a loop that compilers unroll: a pragma needs a line of its own."""
    return text.replace("UNROLL ", "\n#pragma unroll\n")

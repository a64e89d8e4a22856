"""C++17 for the CPU: one header without dependencies, and a project that tests it."""

import re
from pathlib import Path

import numpy as np

from warp_neural.export.language import Language
from warp_neural.export.program import Program
from warp_neural.export.statements import number

TEXT = Path(__file__).parent / "text"
PER_LINE = 8


class Cpp(Language):
    def array(self, name: str, size: int) -> str:
        return f"alignas(64) float {name}[{size}];"


def header(program: Program, name: str, about: str) -> str:
    """Everything in namespace `name`; `evaluate` is a function of one sample."""
    math = "".join(f"    {line}\n" if line else "\n" for line in (TEXT / "math.hpp").read_text().splitlines())
    return f"""// {about}
// Include it anywhere; it needs C++17 and nothing else. Compile without -ffast-math, and with -ffp-contract=off where
// the processor multiplies and adds at once (-march=native): that stands where it is meant, elsewhere it changes bits.
// Where it cannot, or may not, each of these is a call of the C library, and all 50 times slower.
#pragma once
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

namespace {name} {{
namespace detail {{

{math}
alignas(64) inline constexpr float weights[] = {{
{table(program.weights)}}};

using uint = std::uint32_t;
inline void evaluate(const float* x, float* y) {{
{Cpp().lines(program.body)}}}

}}  // namespace detail

inline constexpr int inputs = {program.n_in}, outputs = {program.n_out};
inline constexpr char hash[] = "{program.digest}";

// One sample.
inline void evaluate(const float (&x)[inputs], float (&y)[outputs]) {{ detail::evaluate(x, y); }}

}}  // namespace {name}
"""


def named(text: str, name: str) -> str:
    """A text with `name` for NAME, but where CMake has that word."""
    return re.sub(r"(?<!add_test\()\bNAME(?=\b|_)", name, text)


def table(values: np.ndarray) -> str:
    literals = [number(value) for value in values]
    rows = (literals[i : i + PER_LINE] for i in range(0, len(literals), PER_LINE))
    return "".join(f"    {', '.join(row)},\n" for row in rows)

"""Layers whose weights stand in the text, in vectors and matrices of four, as shading languages have them."""

import re
from typing import Protocol

import numpy as np

from warp_neural.export.language import INDENT
from warp_neural.export.statements import Layer, number

WIDEST = 128  # neurons of a layer: its weights are text, 0.2 MB where two layers have as many


class Vectors(Protocol):
    """What a language has for them: the declaration of a vector, and a matrix [4 results, 4 inputs] times one."""

    def vector(self, name: str, values: str) -> str: ...

    def times(self, matrix: np.ndarray, vector: str) -> str: ...


def layer(language: Vectors, each: Layer, depth: int) -> str:
    """Vectors between layers are NAME_0, NAME_4, ..."""
    n_out, n_in = each.weights.shape
    weights = np.pad(each.weights, ((0, -n_out % 4), (0, -n_in % 4)))
    biases, lines = np.pad(each.biases, (0, -n_out % 4)), []
    if each.first:
        for k in range(0, n_in, 4):
            terms = [f"{each.source}[{i}]" if i < n_in else "0.0" for i in range(k, k + 4)]
            lines.append(language.vector(f"{each.source}_{k}", ", ".join(terms)))
    for o in range(0, n_out, 4):
        z = f"{each.target}_{o}"
        lines.append(language.vector(z, literals(biases[o : o + 4])))
        for k in range(0, n_in, 4):
            lines.append(f"{z} += {language.times(weights[o : o + 4, k : k + 4], f'{each.source}_{k}')};")
        results = [re.sub(r"\bz\b", f"{z}.{c}", each.result) for c in "xyzw"[: n_out - o]]
        if each.last:
            lines += [f"{each.target}[{o + i}] = {result};" for i, result in enumerate(results)]
        elif each.result != "z":
            lines += [f"{z}.{c} = {result};" for c, result in zip("xyzw", results, strict=False)]
    return "".join(f"{depth * INDENT}{line}\n" for line in lines)


def literals(values: np.ndarray) -> str:
    return ", ".join(number(value)[:-1] for value in values.ravel())

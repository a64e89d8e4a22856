"""Fragment shaders of WebGL2, GLSL ES 3.00: layers unrolled, their weights in the text.

Indexed arrays of constants are 20 times slower there, and storage buffers there are none. Parameters of encodings are
looked up by computed places: they are a texture.
"""

import re

import numpy as np

from warp_neural.export import library
from warp_neural.export.language import INDENT
from warp_neural.export.program import Program
from warp_neural.export.shaders import Glsl
from warp_neural.export.statements import Layer, Statement, number

TABLE_WIDTH = 1024
TABLE = f"""uniform sampler2D weights;
float weight(int i) {{ return texelFetch(weights, ivec2(i % {TABLE_WIDTH}, i / {TABLE_WIDTH}), 0).r; }}"""


class Gles(Glsl):
    first = "#version 300 es\nprecision highp float;\nprecision highp int;\nprecision highp sampler2D;\n"
    natives = Glsl.natives.replace("fma(a, b, c)", "a * b + c")

    def fragment(self, program: Program, about: str, main: str) -> str:
        """main: declarations and functions after `evaluate`, `main` among them."""
        body = self.lines(program.body)
        functions = (self.function(each) for each in library.ALL if f"{each.name}(" in body)
        table = TABLE if "weight(" in body else ""
        parts = [self.natives, table, *functions, self.evaluate, main]
        text = "\n".join([f"{self.first}// {about}", *(part.strip("\n") for part in parts if part)])
        text = text.replace("{n_in}", str(program.n_in)).replace("{n_out}", str(program.n_out))
        return f"{text.replace('BODY', body.rstrip())}\n"

    def set(self, target: str, value: str) -> str:
        return super().set(target, re.sub(r"\bweights\[([^]]*)]", r"weight(int(\1))", value))

    def line(self, each: Statement, depth: int) -> str:
        return self.layer(each, depth) if isinstance(each, Layer) else super().line(each, depth)

    def layer(self, each: Layer, depth: int) -> str:
        """Vectors between layers are vec4s: NAME_0, NAME_4, ..."""
        n_out, n_in = each.weights.shape
        weights = np.pad(each.weights, ((0, -n_out % 4), (0, -n_in % 4)))
        biases, lines = np.pad(each.biases, (0, -n_out % 4)), []
        if each.first:
            for k in range(0, n_in, 4):
                terms = [f"{each.source}[{i}]" if i < n_in else "0.0" for i in range(k, k + 4)]
                lines.append(f"vec4 {each.source}_{k} = vec4({', '.join(terms)});")
        for o in range(0, n_out, 4):
            z = f"{each.target}_{o}"
            lines.append(f"vec4 {z} = vec4({_literals(biases[o : o + 4])});")
            for k in range(0, n_in, 4):
                lines.append(f"{z} += mat4({_literals(weights[o : o + 4, k : k + 4].T.ravel())}) * {each.source}_{k};")
            results = [re.sub(r"\bz\b", f"{z}.{c}", each.result) for c in "xyzw"[: n_out - o]]
            if each.last:
                lines += [f"{each.target}[{o + i}] = {result};" for i, result in enumerate(results)]
            elif each.result != "z":
                lines.append(f"{z} = vec4({', '.join([*results, '0.0', '0.0', '0.0'][:4])});")
        return "".join(f"{depth * INDENT}{line}\n" for line in lines)


def _literals(values: np.ndarray) -> str:
    return ", ".join(number(value)[:-1] for value in values)

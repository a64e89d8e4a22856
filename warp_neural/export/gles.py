"""Fragment shaders of WebGL2, GLSL ES 3.00: layers unrolled, their weights in the text.

Indexed arrays of constants are 20 times slower there, and storage buffers there are none. Parameters of encodings are
looked up by computed places: they are a texture.
"""

import re

from warp_neural.export import library
from warp_neural.export.program import Program
from warp_neural.export.shaders import Glsl

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

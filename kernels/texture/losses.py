"""What an error of a texel costs: squared errors, of normals by their direction, of colours by their brightness."""

from dataclasses import dataclass
from typing import Literal

from warp_neural.kernels.nn.losses import Loss

Cost = Literal["l2", "direction", "perceptual"]
RADIAL = 0.1  # what an error along a normal counts: it goes where the normal is made unit length
CHROMA = 0.25  # what an error of a colour beside its brightness counts: the eye sees it less
LUMA = "{0.299f, 0.587f, 0.114f}"  # ITU-R BT.601, of encoded colours, as JPEG has them


@dataclass(frozen=True)
class TextureLoss(Loss):
    """Squared errors where there is a target; a NaN target lets the prediction be anything.

    normals, colours: the first of three channels whose error e costs otherwise. Of a normal whose target has direction
    u: |e|^2 - (1 - RADIAL) (e.u)^2. Of a colour with y = LUMA.e: 3 y^2 + CHROMA |e - y|^2, of grey its squared error.
    """

    normals: tuple[int, ...] = ()
    colours: tuple[int, ...] = ()

    def value_text(self, n: int) -> str:
        return super().value_text(n) + self.of_triples(f"loss += w[c] * {1 / n!r}f * more;")

    def gradient_text(self, n: int) -> str:
        return super().gradient_text(n) + self.of_triples(
            f"for (int i = 0; i < 3; ++i) d[c + i] += w[c] * {1 / n!r}f * slope[i];"
        )

    def of_triples(self, statement: str) -> str:
        """With `more`, what each costs beyond squared errors, its `slope`, and `c`, its first channel."""
        kinds = [(self.normals, NORMAL), (self.colours, COLOUR)]
        return "".join(f"{{\nconst int c = {c};\n{ERROR}{kind}{statement}\n}}\n" for cs, kind in kinds for c in cs)


ERROR = """real e[3], more = 0.0f, slope[3];
bool known = true;
for (int i = 0; i < 3; ++i) known = known && wp::isfinite(target.c[c + i]);
for (int i = 0; i < 3; ++i) e[i] = known ? prediction.c[c + i] - target.c[c + i] : 0.0f;
"""
NORMAL = f"""real square = 1e-6f, along = 0.0f, u[3];
for (int i = 0; i < 3; ++i) {{
    u[i] = known ? 2.0f * target.c[c + i] - 1.0f : 0.0f;
    square += u[i] * u[i];
    along += e[i] * u[i];
}}
more = {RADIAL - 1}f * along * along / square;
for (int i = 0; i < 3; ++i) slope[i] = {2 * (RADIAL - 1)}f * along / square * u[i];
"""
COLOUR = f"""const real luma[3] = {LUMA};
const real y = luma[0] * e[0] + luma[1] * e[1] + luma[2] * e[2], beside = e[0] + e[1] + e[2] - 3.0f * y;
more = 3.0f * y * y;
for (int i = 0; i < 3; ++i) {{
    more += {CHROMA}f * (e[i] - y) * (e[i] - y) - e[i] * e[i];
    slope[i] = 6.0f * y * luma[i] + {2 * CHROMA}f * (e[i] - y - luma[i] * beside) - 2.0f * e[i];
}}
"""

known_l2 = TextureLoss(
    "known_l2", "(wp::isfinite(t) ? (p - t) * (p - t) : 0.0f)", "(wp::isfinite(t) ? 2.0f * (p - t) : 0.0f)"
)

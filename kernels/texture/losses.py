"""What an error of a texel costs: its square, of normals by their angle, of colours more where luminance is off."""

from dataclasses import dataclass
from typing import Literal

from warp_neural.kernels.nn.losses import Loss, for_each

Cost = Literal["l2", "angle", "luminance"]
RADIAL = 0.25  # what an error of a normal's length counts, which goes when it is made unit length
CHROMA = 0.3  # what an error of chroma counts; 0.1 costs more PSNR and gives no more SSIM of luminance


@dataclass(frozen=True)
class TextureLoss(Loss):
    """Squared errors where there is a target; a NaN target lets the prediction be anything.

    normals: the first of three channels, where unit vectors u are stored as (u + 1) / 2: with directions a, b and
    lengths |u|, |v|, the error costs (|a - b|^2 + RADIAL (|u| - |v|)^2) / 4. colours: the first of three channels red,
    green, blue: with their errors r, g, b and y = 0.2126 r + 0.7152 g + 0.0722 b (ITU-R BT.709) the error costs 3 y^2 +
    CHROMA ((r - y)^2 + (b - y)^2), as much as three squares where it is grey.
    """

    normals: tuple[int, ...] = ()
    colours: tuple[int, ...] = ()

    def value_text(self, n: int) -> str:
        vectors = self.of_vectors(f"loss += w[c] * {1 / n!r}f * cost;")
        return f"{for_each(n, f'loss += {self.weight} * ({self.term});')}loss *= {1 / n!r}f;\n{vectors}"

    def gradient_text(self, n: int) -> str:
        vectors = self.of_vectors(f"for (int i = 0; i < 3; ++i) d[c + i] = w[c] * {1 / n!r}f * slope[i];")
        return for_each(n, f"d[i] = {self.weight} * {1 / n!r}f * ({self.slope});") + vectors

    @property
    def weight(self) -> str:
        """Of channel i; of vectors 0."""
        return "w[i]" + "".join(f" * (i >= {c} && i < {c + 3} ? 0.0f : 1.0f)" for c in self.normals + self.colours)

    def of_vectors(self, statement: str) -> str:
        pieces = [(c, ANGLE) for c in self.normals] + [(c, LUMINANCE) for c in self.colours]
        return "".join(f"{{\nconst int c = {c};\n{text}{statement}\n}}\n" for c, text in pieces)


ANGLE = f"""real u[3], v[3], slope[3] = {{}}, cost = 0.0f, dot = 0.0f, uu = 1e-4f, vv = 1e-4f;
for (int i = 0; i < 3; ++i) {{
    u[i] = 2.0f * prediction.c[c + i] - 1.0f;
    v[i] = 2.0f * target.c[c + i] - 1.0f;
    dot += u[i] * v[i];
    uu += u[i] * u[i];
    vv += v[i] * v[i];
}}
if (wp::isfinite(vv)) {{
    const real length = wp::sqrt(uu), wanted = wp::sqrt(vv), cosine = dot / (length * wanted);
    cost = 0.5f * (1.0f - cosine) + {RADIAL / 4}f * (length - wanted) * (length - wanted);
    for (int i = 0; i < 3; ++i)
        slope[i] = (cosine * u[i] / length - v[i] / wanted + {RADIAL}f * (length - wanted) * u[i]) / length;
}}
"""

LUMINANCE = f"""real e[3], slope[3] = {{}}, cost = 0.0f, y = 0.0f;
const real part[3] = {{0.2126f, 0.7152f, 0.0722f}};
for (int i = 0; i < 3; ++i) {{
    e[i] = prediction.c[c + i] - target.c[c + i];
    y += part[i] * e[i];
}}
if (wp::isfinite(y)) {{
    const real red = e[0] - y, blue = e[2] - y;
    cost = 3.0f * y * y + {CHROMA}f * (red * red + blue * blue);
    for (int i = 0; i < 3; ++i)
        slope[i] = part[i] * (6.0f * y - {2 * CHROMA}f * (red + blue));
    slope[0] += {2 * CHROMA}f * red;
    slope[2] += {2 * CHROMA}f * blue;
}}
"""

known_l2 = TextureLoss(
    "known_l2", "(wp::isfinite(t) ? (p - t) * (p - t) : 0.0f)", "(wp::isfinite(t) ? 2.0f * (p - t) : 0.0f)"
)

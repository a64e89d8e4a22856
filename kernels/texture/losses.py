"""What an error of a texel costs: its square, of normals by their angle, of some maps by how well it is seen."""

from dataclasses import dataclass
from typing import Literal

import warp as wp

from warp_neural.kernels.nn.losses import Loss, for_each

Cost = Literal["l2", "angle", "perceptual"]
RADIAL = 0.25  # what an error of a normal's length counts, which goes when it is made unit length


@dataclass(frozen=True)
class TextureLoss(Loss):
    """Squared errors where there is a target; a NaN target lets the prediction be anything.

    normals: the first of three channels, where unit vectors u are stored as (u + 1) / 2: with directions a, b and
    lengths |u|, |v|, the error costs (|a - b|^2 + RADIAL (|u| - |v|)^2) / 4. seen: (first channel, channels) of maps
    whose errors count as much as a weight of the texel, which follows its target's channels, in this order.
    """

    normals: tuple[int, ...] = ()
    seen: tuple[tuple[int, int], ...] = ()

    def target_type(self, n: int) -> type:
        return wp.types.vector(n + len(self.seen), float)

    def value_text(self, n: int) -> str:
        angles = self.of_normals(f"loss += w[c] * {1 / n!r}f * cost;")
        return f"{for_each(n, f'loss += {self.weight(n)} * ({self.term});')}loss *= {1 / n!r}f;\n{angles}"

    def gradient_text(self, n: int) -> str:
        angles = self.of_normals(f"for (int i = 0; i < 3; ++i) d[c + i] = w[c] * {1 / n!r}f * slope[i];")
        return for_each(n, f"d[i] = {self.weight(n)} * {1 / n!r}f * ({self.slope});") + angles

    def weight(self, n: int) -> str:
        """Of channel i; of normals 0."""
        result = "w[i]"
        for k, (first, count) in enumerate(self.seen):
            m = f"target.c[{n + k}]"
            result += f" * (i >= {first} && i < {first + count} ? (wp::isfinite({m}) ? {m} : 0.0f) : 1.0f)"
        for c in self.normals:
            result += f" * (i >= {c} && i < {c + 3} ? 0.0f : 1.0f)"
        return result

    def of_normals(self, statement: str) -> str:
        return "".join(f"{{\nconst int c = {c};\n{ANGLE}{statement}\n}}\n" for c in self.normals)


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

known_l2 = TextureLoss(
    "known_l2", "(wp::isfinite(t) ? (p - t) * (p - t) : 0.0f)", "(wp::isfinite(t) ? 2.0f * (p - t) : 0.0f)"
)

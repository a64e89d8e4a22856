"""The loss of the main job: what it is measured by."""

from dataclasses import dataclass

import warp_neural as wn

ERROR = "const real e = p - t, q = p + 0.01f; "


@dataclass(frozen=True)
class RelativeError(wn.losses.Loss):
    """||p - t|| / ||t|| of all components together, plus `weights` times the |p - t| / (p + 0.01) of each.

    Both are smoothed below an error of 0.5 %, e to sqrt(e^2 + 0.005^2), without which the last digits would jump from
    one sign to the other. Denominators count as constant. Of each component it is the prediction and not the target
    that divides: else one that is far too small, of an exponential, would have no gradient and stay there.
    """

    smooth: float = 0.005

    def value_text(self, n: int) -> str:
        term = f"{ERROR}loss += w[i] * wp::sqrt(e * e + small * q * q) / q;"
        return f"{self.sums(n)}{wn.losses.for_each(n, term)}loss += wp::sqrt((error + small * size) / size);\n"

    def gradient_text(self, n: int) -> str:
        slope = "w[i] * e / (wp::sqrt(e * e + small * q * q) * q) + e / wp::sqrt((error + small * size) * size)"
        return self.sums(n) + wn.losses.for_each(n, f"{ERROR}d[i] = {slope};")

    def sums(self, n: int) -> str:
        sums = wn.losses.for_each(n, "size += t * t; error += (p - t) * (p - t);")
        return f"const real small = {self.smooth**2!r}f;\nreal size = 1e-12f, error = 0.0f;\n{sums}"

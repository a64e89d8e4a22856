"""Several encodings side by side."""

from dataclasses import dataclass
from math import gcd

from kernels.encodings.base import Encoding


@dataclass(frozen=True)
class Concatenate(Encoding):
    """The results of `parts` one after the other, and so their parameters.

    inputs: for each part the indices of the inputs that it reads; None is all of them for every part. Parts with
    parameters have one common range of initial values.
    """

    parts: tuple[Encoding, ...]
    inputs: tuple[tuple[int, ...], ...] | None = None

    def __post_init__(self):
        if not self.parts:
            raise ValueError("Concatenate: no parts; at least one is needed")
        if self.inputs is not None and len(self.inputs) != len(self.parts):
            raise ValueError(f"Concatenate: inputs of {len(self.inputs)} for {len(self.parts)} parts; give one a part")
        ranges = {part.initial for part in self.parts} - {(0.0, 0.0)}
        if len(ranges) > 1:
            raise ValueError(f"Concatenate: initial ranges {sorted(ranges)}; give the parts one, `initial`")

    @property
    def initial(self) -> tuple[float, float]:
        return max((part.initial for part in self.parts), key=lambda r: r != (0.0, 0.0))

    def n_out(self, n_in: int) -> int:
        return sum(part.n_out(len(indices)) for part, indices in self.reads(n_in))

    def n_parameters(self, n_in: int) -> int:
        return sum(part.n_parameters(len(indices)) for part, indices in self.reads(n_in))

    def reads(self, n_in: int) -> list[tuple[Encoding, tuple[int, ...]]]:
        """Each part with the inputs that it reads."""
        for indices in self.inputs or ():
            if not indices or not all(0 <= i < n_in for i in indices):
                raise ValueError(f"Concatenate: a part reads inputs {indices} of {n_in}")
        return list(zip(self.parts, self.inputs or [tuple(range(n_in))] * len(self.parts), strict=True))

    def forward(self, n_in: int, aligned: int) -> str:
        return self.for_each_part(
            n_in, aligned, "forward", "real* const own_out = out + {first};", "real* const out = own_out;"
        )

    def adjoint(self, n_in: int, aligned: int) -> str:
        own = """real* const own_grad = grad ? grad + {start} : nullptr;
const real* const own_d_out = d_out + {first};
real own_d_in[{n}] = {{}};"""
        return self.for_each_part(
            n_in,
            aligned,
            "adjoint",
            own,
            "real* const grad = own_grad;\nconst real* const d_out = own_d_out;\nreal* const d_in = own_d_in;",
        )

    def for_each_part(self, n_in: int, aligned: int, method: str, own: str, enter: str) -> str:
        """The parts' texts, each in a scope where the names of `base` mean the part's own share."""
        text, first, start = "", 0, 0
        for part, indices in self.reads(n_in):
            n = len(indices)
            text += f"""{{
const real own_in[{n}] = {{{", ".join(f"in[{i}]" for i in indices)}}};
const real* const own_p = p + {start};
{own.format(first=first, start=start, n=n)}
{{
const real* const in = own_in;
const real* const p = own_p;
{enter}
{getattr(part, method)(n, gcd(aligned, start))}}}
"""
            if method == "adjoint":
                text += "".join(f"d_in[{i}] += own_d_in[{k}];\n" for k, i in enumerate(indices))
            text += "}\n"
            first, start = first + part.n_out(n), start + part.n_parameters(n)
        return text

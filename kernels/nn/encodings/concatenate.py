"""Several encodings side by side."""

from dataclasses import dataclass
from math import gcd

from warp_neural.kernels.errors import InputError, require
from warp_neural.kernels.nn.encodings.base import Encoding, Leaf


@dataclass(frozen=True)
class Concatenate(Encoding):
    """The results of `parts` one after the other, and so their parameters.

    inputs: for each part the indices of the inputs that it reads; None is all of them for every part. Parts with
    parameters have one common range of initial values.
    """

    parts: tuple[Encoding, ...]
    inputs: tuple[tuple[int, ...], ...] | None = None

    def __post_init__(self):
        valid = isinstance(self.parts, tuple) and all(isinstance(part, Encoding) for part in self.parts) and self.parts
        require(valid, "Concatenate: parts", self.parts, "a tuple of encodings, at least one")
        if self.inputs is not None:
            valid = isinstance(self.inputs, tuple) and all(isinstance(indices, tuple) for indices in self.inputs)
            require(valid, "Concatenate: inputs", self.inputs, "a tuple of indices for each part")
            if len(self.inputs) != len(self.parts):
                raise InputError(
                    f"Concatenate: inputs of {len(self.inputs)} for {len(self.parts)} parts; give one a part"
                )
        ranges = {part.initial for part in self.parts} - {(0.0, 0.0)}
        if len(ranges) > 1:
            raise InputError(f"Concatenate: initial ranges {sorted(ranges)}; give the parts one, `initial`")

    @property
    def initial(self) -> tuple[float, float]:
        return max((part.initial for part in self.parts), key=lambda r: r != (0.0, 0.0))

    @property
    def sparse(self) -> bool:
        return all(part.sparse for part in self.parts)

    def n_out(self, n_in: int) -> int:
        return sum(part.n_out(len(indices)) for part, indices in self.reads(n_in))

    def n_parameters(self, n_in: int) -> int:
        return sum(part.n_parameters(len(indices)) for part, indices in self.reads(n_in))

    def reads(self, n_in: int) -> list[tuple[Encoding, tuple[int, ...]]]:
        """Each part with the inputs that it reads."""
        for indices in self.inputs or ():
            if not indices or not all(0 <= i < n_in for i in indices):
                raise InputError(
                    f"Concatenate: a part reads inputs {indices} of {n_in}; give indices of 0 to {n_in - 1}"
                )
        return list(zip(self.parts, self.inputs or [tuple(range(n_in))] * len(self.parts), strict=True))

    def leaves(self, n_in: int) -> list[Leaf]:
        leaves, first, start = [], 0, 0
        for part, indices in self.reads(n_in):
            n = len(indices)
            for encoding, inputs, result, parameter in part.leaves(n):
                leaves.append(Leaf(encoding, tuple(indices[i] for i in inputs), first + result, start + parameter))
            first, start = first + part.n_out(n), start + part.n_parameters(n)
        return leaves

    def encode_text(self, n_in: int, aligned: int) -> str:
        return self.for_each_part(n_in, aligned, "encode_text", {"out": "out + {first}"})

    def adjoint_text(self, n_in: int, aligned: int) -> str:
        own = {"d_in": "part_d_in", "d_out": "d_out + {first}", "grad": "grad ? grad + {start} : nullptr"}
        return self.for_each_part(n_in, aligned, "adjoint_text", own)

    def for_each_part(self, n_in: int, aligned: int, method: str, own: dict[str, str]) -> str:
        """The parts' texts, each in a scope where the names of `base` mean the part's own."""
        own = {"in": "part_in", "p": "p + {start}", **own}
        text, first, start = "", 0, 0
        for part, indices in self.reads(n_in):
            n = len(indices)
            text += f"""{{
const real part_in[{n}] = {{{", ".join(f"in[{i}]" for i in indices)}}};
real part_d_in[{n}] = {{}};
{"".join(f"auto* const own_{name} = {v.format(first=first, start=start)};" for name, v in own.items())}
{{
{"".join(f"auto* const {name} = own_{name};" for name in own)}
{getattr(part, method)(n, gcd(aligned, start))}}}
"""
            if method == "adjoint_text":
                text += "".join(f"d_in[{i}] += part_d_in[{k}];\n" for k, i in enumerate(indices))
            text += "}\n"
            first, start = first + part.n_out(n), start + part.n_parameters(n)
        return text

"""Another encoding of inputs that are scaled and shifted first."""

from dataclasses import dataclass

from warp_neural.kernels.errors import is_finite, require
from warp_neural.kernels.nn.encodings.base import Encoding, number


@dataclass(frozen=True)
class Scaled(Encoding):
    """`encoding` of `scale` * x + `offset`, for every input x alike.

    tiny-cuda-nn has directions as (v + 1) / 2: `Scaled(SphericalHarmonics(4), 2.0, -1.0)` takes them. The gradient
    holds the factor `scale`.
    """

    encoding: Encoding
    scale: float = 1.0
    offset: float = 0.0

    def __post_init__(self):
        require(isinstance(self.encoding, Encoding), "Scaled: encoding", self.encoding, "one of wn.encodings")
        require(is_finite(self.scale), "Scaled: scale", self.scale, "a finite number")
        require(is_finite(self.offset), "Scaled: offset", self.offset, "a finite number")

    @property
    def initial(self) -> tuple[float, float]:
        return self.encoding.initial

    @property
    def sparse(self) -> bool:
        return self.encoding.sparse

    def n_out(self, n_in: int) -> int:
        return self.encoding.n_out(n_in)

    def n_parameters(self, n_in: int) -> int:
        return self.encoding.n_parameters(n_in)

    def encode_text(self, n_in: int, aligned: int) -> str:
        return self.within(n_in, self.encoding.encode_text(n_in, aligned), "in")

    def adjoint_text(self, n_in: int, aligned: int) -> str:
        text = self.within(n_in, self.encoding.adjoint_text(n_in, aligned), "in", "d_in")
        add = f"for (int i = 0; i < {n_in}; ++i) d_in[i] += {number(self.scale)} * scaled_d_in[i];\n"
        return f"{{\nreal scaled_d_in[{n_in}] = {{}};\n{text}{add}}}\n"

    def within(self, n_in: int, text: str, *names: str) -> str:
        """`text` in a scope where `names` mean the inner encoding's own."""
        inputs = ", ".join(f"{number(self.scale)} * in[{i}] + {number(self.offset)}" for i in range(n_in))
        own = "".join(f"auto* const {name} = scaled_{name};\n" for name in names)
        return f"{{\nconst real scaled_in[{n_in}] = {{{inputs}}};\n{{\n{own}{text}}}\n}}\n"

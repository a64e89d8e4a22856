"""What a module computes, and the order of its parameters."""

from dataclasses import dataclass

from warp_neural.kernels.nn.encodings import Encoding
from warp_neural.kernels.nn.spec import NetworkSpec, round_up


@dataclass(frozen=True)
class Shape:
    """An encoding, a network, or one after the other.

    Parameters lie as in `MLP.master`: of each layer weights [n_out, n_in] row major, then biases; from a multiple of 4
    on, those of the encoding. trained_biases: of each layer; the others keep their values, as tiny-cuda-nn has none.
    """

    n_in: int
    encoding: Encoding | None
    spec: NetworkSpec | None
    trained_biases: tuple[bool, ...] = ()

    @property
    def n_out(self) -> int:
        return self.spec.sizes[-1] if self.spec else self.encoding.n_out(self.n_in)

    @property
    def encoding_start(self) -> int:
        n = self.spec.n_parameters if self.spec else 0
        return round_up(n, 4) if self.encoding else n

    @property
    def n_parameters(self) -> int:
        return self.encoding_start + (self.encoding.n_parameters(self.n_in) if self.encoding else 0)

    @property
    def resting(self) -> list[slice]:
        """The parameters whose gradient is 0: biases that are not trained."""
        if not self.spec:
            return []
        places = zip(self.spec.layers, self.spec.offsets, self.trained_biases, strict=True)
        return [slice(start + n * k, start + n * k + n) for (k, n), start, trained in places if not trained]

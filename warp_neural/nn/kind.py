"""What networks are but for their numbers: what `MLP` and `NetworkState` say of themselves alike."""

from typing import Any

from warp_neural.errors import InputError
from warp_neural.kernels.nn.encodings import Encoding
from warp_neural.kernels.nn.spec import NetworkSpec, round_up

IMPLEMENTATIONS = ("cooperative", "per_thread", "tiled")


class Kind:
    """`count` networks of `spec`, after an `encoding` of `n_in` inputs or None, as one of `IMPLEMENTATIONS`."""

    spec: NetworkSpec
    count: int
    implementation: str
    encoding: Encoding | None
    n_in: int

    @property
    def kind(self) -> tuple[Any, ...]:
        """Networks of one kind can take each other's numbers."""
        return self.spec, self.count, self.implementation, self.encoding, self.n_in

    def require_kind(self, other: "Kind") -> None:
        """Raise `InputError` unless `other` is of this kind."""
        if other.kind != self.kind:
            here = self.description
            raise InputError(f"of another network, {other.description}, and this is {here}; make the same MLP first")

    @property
    def description(self) -> str:
        """One line of sizes, types and encoding."""
        spec, sizes = self.spec, "-".join(map(str, self.spec.sizes))
        parts = [f"{self.n_in} -> {self.encoding} -> {sizes}" if self.encoding else sizes]
        parts += [spec.activation.name, spec.output_activation.name, self.precision]
        parts += ["float16 sums"] if spec.accumulation == "float16" else []
        parts += [f"{spec.dtype.__name__} vectors"] if spec.dtype.__name__ != "float32" else []
        parts += [self.implementation] + ([f"count={self.count}"] if self.count > 1 else [])
        return ", ".join(parts)

    @property
    def n_out(self) -> int:
        return self.spec.sizes[-1]

    @property
    def depth(self) -> int:
        """Hidden layers."""
        return len(self.spec.layers) - 1

    @property
    def width(self) -> int:
        """Of the hidden layers; 0 without any."""
        return self.spec.sizes[1] if self.depth else 0

    @property
    def precision(self) -> str:
        """The name of the format."""
        return self.spec.format.name

    @property
    def n_parameters(self) -> int:
        """Trainable numbers of one of the `count` networks: weights, biases and its encoding's parameters."""
        return self.spec.n_parameters + (self.encoding.n_parameters(self.n_in) if self.encoding else 0)

    @property
    def encoding_start(self) -> int:
        """Where the parameters of the encodings start in `MLP.master`, aligned to 16 bytes."""
        return round_up(self.count * self.spec.n_parameters, 4)

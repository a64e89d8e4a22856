"""Networks between our files and RTXNS's: which form a file has, and what each form can hold of the other."""

from dataclasses import replace
from enum import Enum
from pathlib import Path

import warp as wp

from warp_neural.errors import InputError
from warp_neural.io.rtxns import MAGIC, RtxnsNetwork, read_binary, write_binary
from warp_neural.io.rtxns_json import read_json, write_json
from warp_neural.io.tensors import short
from warp_neural.kernels.nn import activations
from warp_neural.kernels.nn.activations import Activation
from warp_neural.kernels.nn.encodings import Encoding
from warp_neural.kernels.nn.spec import FLOAT16, NetworkSpec
from warp_neural.nn.mlp import MLP
from warp_neural.nn.network_file import make_network
from warp_neural.nn.state import NetworkState


class Form(Enum):
    """Of a network's file, with its suffix."""

    SAFETENSORS = ".safetensors"
    RTXNS_BINARY = ".bin"
    RTXNS_JSON = ".json"

    @classmethod
    def of_suffix(cls, path: Path | str) -> "Form":
        """The form that a new file gets."""
        try:
            return cls(Path(path).suffix.lower())
        except ValueError:
            raise InputError(f"{path}: unknown suffix; use {', '.join(form.value for form in cls)}") from None

    @classmethod
    def of_file(cls, path: Path | str) -> "Form":
        """The form of an existing file by its first bytes, whatever its name."""
        path = Path(path)
        if not path.is_file():
            raise InputError(f"{path}: no such file; check the name")
        try:
            with open(path, "rb") as file:
                head = file.read(64)
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror}); check its permissions") from error
        if head[1:4] == MAGIC.to_bytes(4, "little")[1:]:
            return cls.RTXNS_BINARY
        if head[8:9] == b"{" and int.from_bytes(head[:8], "little") < path.stat().st_size:  # after its header's length
            return cls.SAFETENSORS
        if head.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] == b"{":
            return cls.RTXNS_JSON
        raise InputError(f"{path}: neither safetensors nor a network of RTXNS, binary or JSON; check the name")


def read_rtxns(path: Path | str) -> RtxnsNetwork:
    """Either form."""
    return read_json(path) if Form.of_file(path) is Form.RTXNS_JSON else read_binary(path)


def load_rtxns(
    path: Path | str,
    *,
    n_in: int | None = None,
    encoding: Encoding | None = None,
    activation: Activation = activations.relu,
    output_activation: Activation = activations.exponential,
    device: wp.DeviceLike = None,
) -> MLP:
    """The network of an RTXNS file, binary or JSON, ready to run and to train on `device`, in float16.

    Activations and encoding are not in the file. Those of RTXNS's shader training are taken for the activations;
    `encoding` of `n_in` inputs, without parameters of its own, is put in front. Raises `InputError` for files that
    `warp_neural.io.rtxns` refuses, and for sizes beyond what `MLP` takes.
    """
    state = from_rtxns(path, read_rtxns(path), activation, output_activation)
    takes = state.spec.sizes[0]
    if encoding:
        if n_in is None or encoding.n_out(n_in) != takes or encoding.n_parameters(n_in):
            raise InputError(
                f"{path}: takes {takes} inputs; give an encoding with as many results of n_in inputs, and without "
                "parameters"
            )
        state = replace(state, encoding=encoding, n_in=n_in)
    elif n_in not in (None, takes):
        raise InputError(f"{path}: takes {takes} inputs, not n_in={n_in}; leave n_in out, or give an encoding")
    return make_network(path, state, device)


def save_rtxns(path: Path | str, net: MLP, *, precision: str = "float16") -> None:
    """Write one network for RTXNS: to `.bin` its binary of `precision`, "float16" or "float32", to `.json` its JSON.

    Activations and encoding are not in these files. Raises `InputError` for what `write_binary` refuses, for several
    networks, and for an encoding with parameters.
    """
    write_rtxns(path, to_rtxns(path, net.state), precision)


def write_rtxns(
    path: Path | str, network: RtxnsNetwork, precision: str = "float16", column_major: bool = False
) -> None:
    """The form that the suffix says."""
    if Form.of_suffix(path) is Form.RTXNS_JSON:
        write_json(path, network)
    else:
        write_binary(path, network, precision=precision, column_major=column_major)


def from_rtxns(
    path: Path | str, network: RtxnsNetwork, activation: Activation, output_activation: Activation
) -> NetworkState:
    """RTXNS's network of `path` as ours, computing in float16 as RTXNS does."""
    try:
        spec = NetworkSpec(network.sizes, activation, output_activation, FLOAT16)
    except ValueError as error:
        raise InputError(f"{path}: {short(error)}; only RTXNS's other form can hold it") from error
    return NetworkState.of_layers(spec, network.weights, network.biases, extra=network.extra)


def to_rtxns(path: Path | str, state: NetworkState) -> RtxnsNetwork:
    """Our network for RTXNS's file `path`."""
    if state.count > 1:
        raise InputError(f"{path}: {state.count} networks, RTXNS's files hold one; save the one alone")
    if state.encoding_parameters.size:
        encoding = short(state.encoding)
        raise InputError(f"{path}: RTXNS's files cannot hold the parameters of {encoding}; use safetensors")
    return RtxnsNetwork(state.weights, state.biases, state.extra)

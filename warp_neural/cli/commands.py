"""The command `warp-neural`: describe files, convert networks, compress textures, export networks, render
materials, list devices."""

import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import tyro
import warp as wp

from warp_neural import __version__, cli
from warp_neural.cli.ending import ending
from warp_neural.cli.export_command import Export
from warp_neural.cli.printing import lines_of
from warp_neural.cli.render_command import Render
from warp_neural.cli.texture_commands import Compress, Decompress
from warp_neural.cli.texture_info import describe_engine, describe_file, is_texture
from warp_neural.coopvec.combinations import combination_table, supported_combinations
from warp_neural.errors import InputError
from warp_neural.io.rtxns import RtxnsNetwork
from warp_neural.io.tensors import load_tensors
from warp_neural.kernels.nn import activations
from warp_neural.kernels.nn.spec import FORMATS
from warp_neural.nn.convert import Form, from_rtxns, read_rtxns, to_rtxns, write_rtxns
from warp_neural.nn.encoding_file import describe_encoding
from warp_neural.nn.network_file import from_tensors, read_state, write_state
from warp_neural.nn.state import NetworkState

_ACTIVATIONS = {activation.name: activation for activation in activations.ALL}
ActivationName = Literal[tuple(_ACTIVATIONS)]


@dataclass(frozen=True, kw_only=True)
class _Command:
    json: bool = False
    """print nothing but one JSON object, as the last line on stdout"""


@dataclass(frozen=True, kw_only=True)
class Info(_Command):
    """Describe a network (safetensors, or RTXNS's binary or JSON), a checkpoint or a neural texture of either form."""

    file: tyro.conf.Positional[Path]
    """of any of these forms, recognised by its content"""

    def main(self) -> dict:
        if is_texture(self.file):
            return describe_file(self.file)
        form = Form.of_file(self.file)
        if form is not Form.SAFETENSORS:
            network = read_rtxns(self.file)
            return {"format": form.name.lower(), **_describe_rtxns(network)}
        tensors, metadata = load_tensors(self.file)
        if metadata.get("format") != "network":
            return self.describe_tensors(tensors, metadata)
        state = from_tensors(self.file, tensors, metadata)
        if "texture" in state.extra:
            return describe_engine(self.file, state)
        return {"format": "safetensors", **_describe(state)}

    def describe_tensors(self, tensors: dict[str, np.ndarray], metadata: dict) -> dict:
        """Of a checkpoint or anything else that `save_tensors` wrote."""
        metadata = json.loads(json.dumps(metadata), parse_constant=str)  # NaN is not JSON
        described = {"format": "tensors", "values": sum(array.size for array in tensors.values()), "metadata": metadata}
        rows = {name: {"type": a.dtype.name, "shape": list(a.shape), "range": _range(a)} for name, a in tensors.items()}
        if self.json:
            return {**described, "tensors": rows}
        for name, row in rows.items():
            print(f"{name!a:24} {row['type']} {row['shape']} {row['range']}")
        return described


@dataclass(frozen=True, kw_only=True)
class Convert(_Command):
    """Convert a network between safetensors and RTXNS's binary and JSON; the suffix of TARGET chooses the form.

    RTXNS's files hold no activations: towards safetensors they are those of its shader training unless given here.
    """

    source: tyro.conf.Positional[Path]
    """of any form, recognised by its content"""
    target: tyro.conf.Positional[Path]
    """.safetensors, .bin (such as .ns.bin) or .json"""
    activation: ActivationName | None = None
    """of the hidden layers, for .safetensors; relu where the source does not say"""
    output_activation: ActivationName | None = None
    """of the last layer, for .safetensors; exponential where the source does not say"""
    precision: Literal["float16", "float32"] = "float16"
    """of the numbers in .bin; RTXNS itself reads float16"""
    column_major: bool = False
    """write the matrices of .bin by columns"""

    def main(self) -> dict:
        if Form.of_suffix(self.target) is Form.SAFETENSORS:
            state = self.to_safetensors()
            write_state(self.target, state)
            return {"written": str(self.target), **_describe(state)}
        if self.activation or self.output_activation:
            raise InputError(f"{self.target}: RTXNS's files hold no activations; leave the options out")
        network, lost = read_as_rtxns(self.target, self.source)
        write_rtxns(self.target, network, self.precision, self.column_major)
        written = read_rtxns(self.target)
        pairs = zip(network.weights + network.biases, written.weights + written.biases, strict=True)
        rounding = max(float(np.abs(a.astype(np.float64) - b).max()) for a, b in pairs)
        return {"written": str(self.target), **_describe_rtxns(written), "largest_rounding": rounding, "left_out": lost}

    def to_safetensors(self) -> NetworkState:
        if Form.of_file(self.source) is Form.SAFETENSORS:
            state = read_state(self.source)
            hidden, last = state.spec.activation, state.spec.output_activation
            hidden = _ACTIVATIONS[self.activation] if self.activation else hidden
            last = _ACTIVATIONS[self.output_activation] if self.output_activation else last
            return replace(state, spec=replace(state.spec, activation=hidden, output_activation=last))
        hidden, last = _ACTIVATIONS[self.activation or "relu"], _ACTIVATIONS[self.output_activation or "exponential"]
        return from_rtxns(self.source, read_rtxns(self.source), hidden, last)


def read_as_rtxns(target: Path, source: Path) -> tuple[RtxnsNetwork, dict]:
    """The network of any file for RTXNS's `target`, and what of it RTXNS's files do not hold."""
    if Form.of_file(source) is not Form.SAFETENSORS:
        return read_rtxns(source), {}
    state = read_state(source)
    described = _describe(state)
    return to_rtxns(target, state), {key: described[key] for key in ("activation", "output_activation", "encoding")}


@dataclass(frozen=True, kw_only=True)
class Devices(_Command):
    """List the devices of this machine and what the cooperative-vector functions take on each."""

    def main(self) -> dict:
        devices, pages = {}, []
        for device in wp.get_devices():
            architecture = f"sm_{device.arch}" if device.is_cuda else "vectorised with Clang"
            row = {"name": device.name, "architecture": architecture}
            if device.is_cuda:
                row["memory_gib"] = round(device.total_memory / 2**30, 1)
            pages.append(f"{device.alias}: {', '.join(map(str, row.values()))}\n{combination_table(device)}\n")
            row["combinations"] = [vars(combination) for combination in supported_combinations(device)]
            devices[device.alias] = row
        summary = {"devices": ", ".join(devices), "precisions": ", ".join(FORMATS)}
        print("\n".join([*lines_of(summary), "", *pages]))
        print("native: tensor cores multiply; otherwise arithmetic per thread that rounds at the same places.")
        print("wn.MLP runs on all of them with each implementation: cooperative, tiled, per_thread.")
        return {"devices": devices} if self.json else {}


def main(args: list[str] | None = None) -> None:
    """Entry point of `warp-neural`."""
    if (sys.argv[1:] if args is None else args) == ["--version"]:
        with ending():
            print(f"warp-neural {__version__}")
        return
    cli.run(
        lambda command: command.main(),
        Info | Compress | Decompress | Convert | Export | Render | Devices,
        args,
        prog="warp-neural",
    )


def _describe(state: NetworkState) -> dict:
    spec, encoding, n_encoding = state.spec, state.encoding, state.encoding_parameters.size
    return {
        "sizes": list(spec.sizes),
        "networks": state.count,
        "parameters": state.parameters.size + n_encoding,
        "activation": spec.activation.name,
        "output_activation": spec.output_activation.name,
        "encoding": describe_encoding(encoding) if encoding else None,
        "precision": spec.format.name,
        "accumulation": spec.accumulation,
        "vectors": spec.dtype.__name__,
        "implementation": state.implementation,
        **_ranges(state.weights, state.biases),
        **({"encoding_range": _range(state.encoding_parameters)} if n_encoding else {}),
        "extra": state.extra,
    }


def _describe_rtxns(network: RtxnsNetwork) -> dict:
    arrays = network.weights + network.biases
    return {
        "sizes": list(network.sizes),
        "parameters": sum(array.size for array in arrays),
        "activation": None,
        "output_activation": None,
        "precision": network.weights[0].dtype.name,
        **_ranges(network.weights, network.biases),
        "extra": network.extra,
    }


def _ranges(weights: list[np.ndarray], biases: list[np.ndarray]) -> dict:
    ranges = {}
    for layer, (w, b) in enumerate(zip(weights, biases, strict=True)):
        ranges |= {f"weights_{layer}": _range(w), f"biases_{layer}": _range(b)}
    return ranges


def _range(array: np.ndarray) -> list[float] | None:
    """[smallest, largest] to six digits, or None if there is none."""
    if not array.size or not np.isfinite(array).all():
        return None
    return [float(f"{value:.6g}") for value in (array.min(), array.max())]

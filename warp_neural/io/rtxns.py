"""Networks in the two forms of RTXNS (NVIDIA's RTX Neural Shading SDK): its binary file and its JSON.

Neither holds activations or the encoding of the inputs: they are in the shader. RTXNS's shader training has ReLU inside
and an exponential at the end. Binary, little endian, version 1:

    0    uint32 0xA1C0DE01: format, and the version in the last byte
    4    uint32 hidden layers, inputs, hidden neurons, outputs
    20   int32 precision of the weights, of the biases: 0 float16, 1 float32
    28   4 bytes of filler
    32   8 layers of 32 bytes: uint32 inputs, outputs; uint64 bytes of the weights, of the biases;
         uint32 offset of the weights, of the biases; unused ones zero
    288  int32 layout of the matrices: 0 row major, 1 column major
    292  4 bytes of filler
    296  uint64 bytes of data
    304  data: weights [n_out, n_in] and biases [n_out] at their offsets, multiples of 64
"""

import struct
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np

from warp_neural.errors import InputError
from warp_neural.io.files import atomic_path
from warp_neural.kernels.errors import require
from warp_neural.kernels.nn.spec import round_up

_HEADER = struct.Struct("<I4I2i4x" + 8 * "2I2Q2I" + "i4xQ")
MAGIC = 0xA1C0DE01
_MAX_LAYERS = 8
_ALIGNMENT = 64
_DTYPES = (np.dtype("<f2"), np.dtype("<f4"))
MAX_BYTES = 2**26  # of a file; a network for shaders has some thousand parameters


@dataclass(frozen=True)
class RtxnsNetwork:
    """Weights [n_out, n_in] and biases [n_out] of each layer, float16 or float32, and what else a JSON file held."""

    weights: list[np.ndarray]
    biases: list[np.ndarray]
    extra: dict = field(default_factory=dict)

    @property
    def sizes(self) -> tuple[int, ...]:
        """(n_in, hidden..., n_out)"""
        return (self.weights[0].shape[1], *(len(bias) for bias in self.biases))


@dataclass(frozen=True)
class _Block:
    """Weights or biases of one layer in the data."""

    name: str
    offset: int
    n_bytes: int

    @property
    def end(self) -> int:
        return self.offset + self.n_bytes


def read_binary(path: Path | str) -> RtxnsNetwork:
    """Read RTXNS's binary form, row or column major, float16 or float32.

    Raises `InputError` that names the field where the header contradicts itself or the file's size, where weights lie
    outside the data, overlap or are not finite, and for another format or version.
    """
    path = Path(path)
    data = read_bytes(path)
    magic = int.from_bytes(data[:4], "little")
    if magic >> 8 != MAGIC >> 8:
        raise InputError(f"{path}: begins with 0x{magic:08X}, not 0x{MAGIC:08X}; it is no binary network of RTXNS")
    if magic != MAGIC:
        raise InputError(f"{path}: version {magic & 255}, only 1 is known; write it with RTXNS's version 1")
    if len(data) < _HEADER.size:
        raise refusal(path, "header", f"cut short at {len(data)} of {_HEADER.size} bytes")
    _, hidden_layers, n_in, width, n_out, *fields, layout, data_bytes = _HEADER.unpack_from(data)
    precisions, records = fields[:2], fields[2:]
    if hidden_layers > _MAX_LAYERS - 1:
        raise refusal(path, "hidden layers", f"{hidden_layers}, at most {_MAX_LAYERS - 1} fit")
    for name, precision in zip(("weight precision", "bias precision"), precisions, strict=True):
        if precision not in (0, 1):
            raise refusal(path, name, f"{precision}, not 0 (float16) or 1 (float32)")
    if layout not in (0, 1):
        raise refusal(path, "matrix layout", f"{layout}, not 0 (row major) or 1 (column major)")
    layers = [tuple(records[i : i + 6]) for i in range(0, len(records), 6)]
    sizes = (n_in, *[width] * hidden_layers, n_out)
    dtypes = [_DTYPES[precision] for precision in precisions]
    blocks = _check_records(path, layers, sizes, dtypes)
    _check_blocks(path, blocks, data_bytes, data[_HEADER.size :])
    return _arrays(path, data, blocks, sizes, dtypes, column_major=layout == 1)


def write_binary(
    path: Path | str, network: RtxnsNetwork, *, precision: str = "float16", column_major: bool = False
) -> None:
    """Write RTXNS's binary form, rounding to `precision`, "float16" (all that RTXNS itself reads) or "float32".

    Raises `InputError` for more than 8 layers, hidden layers of different widths, and values beyond the precision.
    """
    require(precision in ("float16", "float32"), "precision", precision, "float16 or float32")
    sizes = network.sizes
    if len(sizes) > _MAX_LAYERS + 1 or len(set(sizes[1:-1])) > 1:
        raise InputError(
            f"{path}: sizes {sizes}; RTXNS's binary has up to 8 layers, hidden ones of one width: use JSON"
        )
    dtype, data, records = np.dtype(precision).newbyteorder("<"), bytearray(), []
    for layer, (weights, biases) in enumerate(zip(network.weights, network.biases, strict=True)):
        offsets = []
        for array in (weights.T if column_major else weights, biases):
            with np.errstate(over="ignore"):  # a value beyond float16 becomes infinite and is refused here
                values = array.astype(dtype)
            if not np.isfinite(values).all():
                raise InputError(f"{path}: layer {layer} has values beyond {dtype.name}; write float32, or as JSON")
            offsets.append(len(data))
            data += values.tobytes()
            data += bytes(-len(data) % _ALIGNMENT)
        records += [*weights.T.shape, weights.size * dtype.itemsize, biases.size * dtype.itemsize, *offsets]
    records += [0] * (6 * _MAX_LAYERS - len(records))
    code = _DTYPES.index(dtype)
    # Without hidden layers RTXNS still wants a positive number of hidden neurons: the outputs.
    header = _HEADER.pack(
        MAGIC, len(sizes) - 2, sizes[0], sizes[1], sizes[-1], code, code, *records, int(column_major), len(data)
    )
    with atomic_path(path) as temporary:
        temporary.write_bytes(header + data)


def read_bytes(path: Path) -> bytes:
    """The content of a file that may hold one network."""
    if not path.is_file():
        raise InputError(f"{path}: no such file; check the name")
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(f"{path}: larger than {MAX_BYTES >> 20} MiB, no network for shaders; check the name")
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check its permissions") from error


def refusal(path: Path, name: str, problem: str) -> InputError:
    return InputError(f"{path}: {name}: {problem}; the file is damaged, write or copy it again")


def _check_records(path: Path, layers: list[tuple], sizes: tuple[int, ...], dtypes: list[np.dtype]) -> list[_Block]:
    """Weights and biases in turn, their sizes in agreement with the header's."""
    blocks = []
    for index, (k, n, weight_bytes, bias_bytes, weight_offset, bias_offset) in enumerate(layers):
        if index >= len(sizes) - 1:
            if any(layers[index]):
                raise refusal(path, f"layer {index}", f"is in use, but the header has {len(sizes) - 1} layers")
            continue
        agree = (
            ("inputs", k, sizes[index]),
            ("outputs", n, sizes[index + 1]),
            ("weight bytes", weight_bytes, n * k * dtypes[0].itemsize),
            ("bias bytes", bias_bytes, n * dtypes[1].itemsize),
        )
        for name, value, expected in agree:
            if value != expected:
                raise refusal(path, f"layer {index} {name}", f"{value}, where the header needs {expected}")
            if value == 0:
                raise refusal(path, f"layer {index} {name}", "none")
        weights = _Block(f"layer {index} weights", weight_offset, weight_bytes)
        biases = _Block(f"layer {index} biases", bias_offset, bias_bytes)
        # RTXNS aligns matrices to 64, and in newer versions the biases behind them to 16.
        if weights.offset % _ALIGNMENT:
            raise refusal(path, weights.name, f"offset {weights.offset} is not a multiple of {_ALIGNMENT}")
        if biases.offset % _ALIGNMENT and biases.offset != round_up(weights.end, 16):
            raise refusal(path, biases.name, f"offset {biases.offset} is not a multiple of {_ALIGNMENT}")
        blocks += [weights, biases]
    return blocks


def _check_blocks(path: Path, blocks: list[_Block], data_bytes: int, data: bytes) -> None:
    """Every block has its place, and nothing but padding follows the last."""
    for block in blocks:
        if block.end > data_bytes:
            raise refusal(path, block.name, f"end at byte {block.end} of the data, which has {data_bytes}")
    ordered = sorted(blocks, key=lambda block: block.offset)
    for before, after in pairwise(ordered):
        if before.end > after.offset:
            raise refusal(path, after.name, f"begin at byte {after.offset} of the data, inside {before.name}")
    end = ordered[-1].end
    if data_bytes not in (end, round_up(end, _ALIGNMENT)):
        raise refusal(path, "data bytes", f"{data_bytes}, where the layers end at {end}")
    rest = data[data_bytes:]
    if len(data) < data_bytes or (rest and (len(data) != round_up(data_bytes, _ALIGNMENT) or any(rest))):
        raise refusal(path, "data bytes", f"{data_bytes}, where the file has {len(data)} after its header")


def _arrays(
    path: Path, data: bytes, blocks: list[_Block], sizes: tuple[int, ...], dtypes: list[np.dtype], column_major: bool
) -> RtxnsNetwork:
    arrays = []
    for index, block in enumerate(blocks):
        dtype = dtypes[index % 2]
        values = np.frombuffer(data, dtype, block.n_bytes // dtype.itemsize, _HEADER.size + block.offset)
        if not np.isfinite(values).all():
            raise refusal(path, block.name, "NaN or infinite")
        arrays.append(values.astype(dtype.newbyteorder("=")))
    weights = []
    for array, k, n in zip(arrays[::2], sizes[:-1], sizes[1:], strict=True):
        weights.append(np.ascontiguousarray(array.reshape(k, n).T) if column_major else array.reshape(n, k))
    return RtxnsNetwork(weights, arrays[1::2])

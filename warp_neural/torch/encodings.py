"""tiny-cuda-nn's encoding configurations as encodings of this package."""

from collections.abc import Callable

from warp_neural.errors import InputError
from warp_neural.kernels.nn.encodings import (
    Concatenate,
    Encoding,
    Frequency,
    HashGrid,
    Identity,
    OneBlob,
    Scaled,
    SphericalHarmonics,
    TriangleWave,
)
from warp_neural.torch.options import Options

LARGEST_TABLE = 28  # log2 of its entries
ONES = Scaled(Identity(), 0.0, 1.0)  # of every input that it reads


def make_encoding(config: dict, n_in: int, where: str = "encoding_config") -> Encoding:
    """The encoding of `n_in` inputs. Raises `InputError` naming what cannot be expressed, and the nearest that can."""
    options = Options(where, config)
    make = options.choice("otype", MAKERS, REFUSED)
    encoding = make(options, n_in)
    options.end()
    return encoding


def pads_with_zeros(encoding: Encoding) -> bool:
    """Whether tiny-cuda-nn fills the inputs up to a network's width with zeros, as after grids, not with ones."""
    return isinstance(encoding.parts[-1] if isinstance(encoding, Concatenate) else encoding, HashGrid)


def pads_in_front(encoding: Encoding) -> bool:
    """Whether its fill comes before the results: after spherical harmonics, without run-time fusion."""
    return isinstance(encoding, Scaled) and isinstance(encoding.encoding, SphericalHarmonics)


def _identity(options: Options, n_in: int) -> Encoding:
    scale, offset = options.real("scale", 1.0), options.real("offset", 0.0)
    return Identity() if (scale, offset) == (1.0, 0.0) else Scaled(Identity(), scale, offset)


def _spherical_harmonics(options: Options, n_in: int) -> Encoding:
    """tiny-cuda-nn's inputs are (v + 1) / 2 of a direction v."""
    return Scaled(SphericalHarmonics(options.whole("degree", 4)), 2.0, -1.0)


def _grid(options: Options, n_in: int, kind: str | None = None) -> Encoding:
    kind = kind or options.choice("type", {"Hash": "Hash", "Dense": "Dense"}, {"Tiled": TILED}, "Hash")
    options.choice("interpolation", {"Linear": None}, {"Smoothstep": LINEAR, "Nearest": LINEAR}, "Linear")
    options.choice("hash", {"CoherentPrime": None}, dict.fromkeys(("Prime", "ReversedPrime", "Rng"), PRIME), PRIMES)
    if options.flag("stochastic_interpolation"):
        raise InputError(f"{options.where}: stochastic_interpolation is not supported; leave it out")
    features, levels = options.whole("n_features_per_level", 2), options.whole("n_levels", 16)
    log2_size, base = options.whole("log2_hashmap_size", 19), options.whole("base_resolution", 16)
    growth = options.real("per_level_scale", 2.0)
    if kind == "Hash":
        return HashGrid(levels, features, log2_size, base, growth)
    grid = HashGrid(levels, features, LARGEST_TABLE, base, growth)
    if any(table.hashed for table in grid.tables(n_in)):
        raise InputError(f"{options.where}: a dense grid of more than 2^{LARGEST_TABLE} vertices; take a HashGrid")
    return grid


def _composite(options: Options, n_in: int) -> Encoding:
    options.choice(
        "reduction", {"Concatenation": None}, dict.fromkeys(("Sum", "Product"), CONCATENATION), "Concatenation"
    )
    nested, options.known = options.left.pop("nested", None), [*options.known, "nested"]
    if not isinstance(nested, list) or not nested:
        raise InputError(f"{options.where}: no 'nested'; give a list of encodings")
    parts, inputs, start, width = [], [], 0, 0
    for i, config in enumerate(nested):
        where, config = f"{options.where}, nested {i}", dict(config)
        own = Options(where, {key: config.pop(key) for key in DIMENSIONS if key in config})
        start = own.whole("dims_to_encode_begin", start, 0)
        count = own.whole("n_dims_to_encode", max(n_in - start, 1))
        if start + count > n_in:
            raise InputError(f"{where}: inputs {start} to {start + count - 1} of {n_in}; give fewer dimensions")
        encoding = make_encoding(config, count, where)
        multiple = encoding.features if isinstance(encoding, HashGrid) else 1
        if missing := -width % multiple:  # tiny-cuda-nn aligns a grid's features
            if pads_with_zeros(parts[-1]):
                raise InputError(f"{where}: {multiple} features after {width} results; put the wider grid first")
            parts.append(ONES)
            inputs.append((0,) * missing)
        parts.append(encoding)
        inputs.append(tuple(range(start, start + count)))
        width, start = width + missing + encoding.n_out(count), start + count
    return Concatenate(tuple(parts), tuple(inputs))


DIMENSIONS = ("n_dims_to_encode", "dims_to_encode_begin")
LINEAR, TILED = "the nearest is 'Linear'", "the nearest is a HashGrid"
PRIMES, PRIME, CONCATENATION = "CoherentPrime", "the nearest is 'CoherentPrime'", "the nearest is 'Concatenation'"

MAKERS: dict[str, Callable[[Options, int], Encoding]] = {
    "Identity": _identity,
    "Frequency": lambda options, n_in: Frequency(options.whole("n_frequencies", 12)),
    "TriangleWave": lambda options, n_in: TriangleWave(options.whole("n_frequencies", 12)),
    "OneBlob": lambda options, n_in: OneBlob(options.whole("n_bins", 16)),
    "SphericalHarmonics": _spherical_harmonics,
    "Grid": _grid,
    "HashGrid": lambda options, n_in: _grid(options, n_in, "Hash"),
    "DenseGrid": lambda options, n_in: _grid(options, n_in, "Dense"),
    "Composite": _composite,
}
REFUSED = {
    "TiledGrid": TILED,
    "OneBlobFrequency": "the nearest is a Composite of TriangleWave, OneBlob and Identity",
    "NRC": "the nearest is a Composite of TriangleWave, OneBlob and Identity",
    "Empty": "the nearest is 'Identity'",
}

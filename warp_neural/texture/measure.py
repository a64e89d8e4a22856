"""How far a decoded texture is from its source: PSNR, SSIM, FLIP, and of hdr the relative error."""

from collections.abc import Sequence

import numpy as np
from skimage.metrics import structural_similarity

from warp_neural.texture.kinds import to_maps
from warp_neural.texture.state import Map

_LEAST = 1e-12  # mean squared error: 120 dB, as of equal values
_SSIM_WINDOW = 11  # Wang et al. 2004: Gaussian weights of sigma 1.5


def codes(values: np.ndarray) -> np.ndarray:
    """What 8 bits hold of values in [0, 1]: clipped, rounded, float32 multiples of 1/255."""
    return np.rint(np.clip(values, 0, 1) * np.float32(255)) / np.float32(255)


def psnr(truth: np.ndarray, result: np.ndarray) -> float:
    """Of 8-bit codes of values in [0, 1], of any one shape; in dB, 120 at most."""
    return _decibels(squared_errors(truth, result).mean())


def squared_errors(truth: np.ndarray, result: np.ndarray) -> np.ndarray:
    """The mean of each channel, [..., channels] to float64 [channels], of 8-bit codes; without truths that are NaN."""
    axes = tuple(range(np.ndim(truth) - 1))
    squared, known = np.square(codes(truth) - codes(result)), ~np.isnan(truth)
    return squared.sum(axes, where=known, dtype=np.float64) / np.maximum(known.sum(axes), 1)


def channel_errors(truth: np.ndarray, result: np.ndarray, maps: Sequence[Map]) -> dict:
    """PSNR of all channels together ("psnr"), and by map: of its channels together and of each.

    truth, result: what the network has as results, [height, width, channels that vary], in [0, 1]: hdr as logarithms.
    A dict for JSON, as is that of `map_errors`.
    """
    squared = squared_errors(truth, result)
    places = np.cumsum([0, *(len(each.trained) for each in maps)])
    rows = {}
    for each, a, b in zip(maps, places[:-1], places[1:], strict=True):
        if b > a:  # constant channels are exact
            rows[each.name] = {"psnr": _decibels(squared[a:b].mean()), "channels": [*map(_decibels, squared[a:b])]}
    return {"psnr": _decibels(squared.mean()), "maps": rows}


def map_errors(truth: np.ndarray, result: np.ndarray, maps: Sequence[Map]) -> dict:
    """`channel_errors`, and for each map SSIM and FLIP as it looks; of hdr also "relative", of normals "degrees".

    See `relative_error` and `angle`. SSIM of pictures smaller than its window is None. FLIP takes seconds a megatexel.
    """
    errors = channel_errors(truth, result, maps)
    pairs = zip(to_maps(truth, maps).items(), to_maps(result, maps).values(), strict=True)
    for each, ((name, a), b) in zip(maps, pairs, strict=True):
        if name in errors["maps"]:
            row = errors["maps"][name]
            if each.kind == "hdr":
                row["relative"] = relative_error(a, b, 2.0 ** each.span[0])
            if each.kind == "normal":
                row["degrees"] = angle(a[..., :3], b[..., :3])
            a, b = shown(a, each), shown(b, each)
            row |= {"ssim": ssim(a, b), "flip": flip(a, b)}
    return errors


def shown(stored: np.ndarray, each: Map) -> np.ndarray:
    """A map as stored to a picture in [0, 1] as it would be displayed, [height, width, 1 or 3]: hdr as its logarithms
    over their range, others as they are; without alpha, two or three channels of colour."""
    colours = stored[..., : 1 if each.channels <= 2 else 3]
    low, high = each.span
    if each.kind == "hdr":
        colours = (np.log2(np.maximum(colours, 0) + 2.0**low) - low) / (high - low)
    elif low < 0 or high > 1:
        colours = (colours - low) / (high - low)
    return codes(colours)


def relative_error(truth: np.ndarray, result: np.ndarray, dark: float) -> float:
    """The root mean square of (result - truth) / (truth + dark), both linear and not negative."""
    ratios = (result - np.float64(truth)) / (truth + dark)
    return float(np.sqrt(np.square(ratios).mean()))


def angle(truth: np.ndarray, result: np.ndarray) -> float:
    """The mean angle in degrees between vectors [..., 3] stored as (x + 1) / 2, of any length."""
    a, b = 2 * np.float64(truth) - 1, 2 * np.float64(result) - 1
    across = np.linalg.norm(np.cross(a, b), axis=-1)  # its arc tangent is exact for small angles too
    return float(np.degrees(np.arctan2(across, (a * b).sum(-1))).mean())


def ssim(truth: np.ndarray, result: np.ndarray) -> float | None:
    """Structural similarity (Wang et al. 2004) of pictures in [0, 1], [height, width, 1 or 3]; the mean of channels."""
    if min(truth.shape[:2]) < _SSIM_WINDOW:
        return None
    options = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
    return float(structural_similarity(truth, result, data_range=1.0, channel_axis=-1, **options))


def flip(truth: np.ndarray, result: np.ndarray) -> float:
    """FLIP (Andersson et al. 2020) of displayed pictures [height, width, 1 (as grey) or 3] at 67 pixels a degree."""
    import flip_evaluator

    pictures = (np.array(np.broadcast_to(x, (*x.shape[:2], 3)), np.float32, order="C") for x in (truth, result))
    return float(flip_evaluator.evaluate(*pictures, "LDR", applyMagma=False)[1])


def _decibels(squared: float) -> float:
    return float(-10 * np.log10(max(squared, _LEAST)))

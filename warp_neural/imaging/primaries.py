"""Linear RGB of other primaries to Rec. 709's, which are sRGB's."""

import numpy as np

REC_709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
"""CIE x, y of red, green, blue and white; OpenEXR's default."""

_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
"""XYZ to sharpened cone responses, in which white is adapted: Lam, 1985; ICC.1:2022, annex E."""


def to_rec_709(pixels: np.ndarray, primaries: tuple[float, ...]) -> np.ndarray:
    """Linear `[..., 3 or 4]` of `primaries` to Rec. 709, white to white by Bradford's adaptation; alpha stays.

    Colours outside of Rec. 709 get negative values. Raises `ValueError` for primaries that span no colours.
    """
    if np.allclose(primaries, REC_709, atol=5e-4):
        return pixels
    matrix = np.linalg.inv(_to_cones(REC_709)) @ _to_cones(primaries)
    if not np.isfinite(matrix).all() or np.abs(matrix).max() > 100:
        raise ValueError(f"primaries {primaries}")
    colours = (pixels[..., :3] @ matrix.T).astype(pixels.dtype)
    return np.concatenate([colours, pixels[..., 3:]], axis=-1)


def _to_cones(primaries: tuple[float, ...]) -> np.ndarray:
    """RGB to Bradford's responses relative to those of white: SMPTE RP 177, with the adaptation left in."""
    xy = np.array(primaries, dtype=np.float64).reshape(4, 2)
    if not np.isfinite(xy).all() or xy[3, 1] <= 0:
        raise ValueError(f"primaries {primaries}")
    xyz = np.column_stack([xy, 1 - xy.sum(axis=1)])  # [4, 3], of any luminance
    white = xyz[3] / xyz[3, 1]
    try:
        rgb_to_xyz = xyz[:3].T * np.linalg.solve(xyz[:3].T, white)
    except np.linalg.LinAlgError as error:
        raise ValueError(f"primaries {primaries}") from error
    return (_BRADFORD @ rgb_to_xyz) / (_BRADFORD @ white)[:, None]

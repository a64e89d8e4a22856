"""Pictures to the block formats that GPUs read.

etcpak compresses colours, BC1 and BC3 within milliseconds, BC7 (modes 1, 5, 6 and 7) in about two seconds a megatexel.
Its BC4 and BC5 are 2 to 4 dB below what the formats can, so these are made here, as is the alpha of the best BC3. The
best BC1 is quicktex's, an optional package.
"""

from typing import Literal

import etcpak
import numpy as np

from warp_neural.errors import InputError

Quality = Literal["fast", "best"]
_BEST_BC1 = 18  # quicktex's highest level


def encode_blocks(values: np.ndarray, format: str, quality: Quality = "fast") -> bytes:
    """Floats in [0, 1] `[height, width, channels]` to blocks of 4 x 4 texels, by rows; edges are repeated outwards.

    quality: of the colours of bc1 and bc3; the others are the same with both. Raises `InputError` if best needs
    quicktex, and it is not installed.
    """
    height, width, channels = values.shape
    codes = np.full((height, width, 4), 255, np.uint8)
    codes[..., :channels] = np.rint(np.clip(values, 0, 1) * 255)
    codes = np.pad(codes, ((0, -height % 4), (0, -width % 4), (0, 0)), mode="edge")
    if format in ("bc4", "bc5"):
        return _joined(*(_single_channel(codes[..., channel]) for channel in range(channels)))
    if quality == "best" and format == "bc1":
        return _joined(_best_colours(codes))
    if quality == "best" and format == "bc3":
        return _joined(_single_channel(codes[..., 3]), _best_colours(codes))
    options = (etcpak.BC7CompressBlockParams(),) if format == "bc7" else ()
    encode = getattr(etcpak, f"compress_{format}")
    return encode(codes.tobytes(), codes.shape[1], codes.shape[0], *options)  # a copy: it may change what it is given


def _joined(*parts: np.ndarray) -> bytes:
    return np.stack(parts, axis=1).astype("<u8").tobytes()


def _best_colours(codes: np.ndarray) -> np.ndarray:
    """BC1 blocks without black, uint64 `[blocks]`."""
    try:
        from quicktex import RawTexture
        from quicktex.s3tc.bc1 import BC1Encoder
    except ImportError:
        raise InputError('quality="best": needs quicktex; pip install warp-neural[blocks], or take "fast"') from None
    opaque = np.dstack([codes[..., :3], np.full_like(codes[..., 0], 255)])
    texture = RawTexture.frombytes(opaque.tobytes(), codes.shape[1], codes.shape[0])
    return np.frombuffer(BC1Encoder(_BEST_BC1).encode(texture).tobytes(), "<u8")


def _single_channel(codes: np.ndarray) -> np.ndarray:
    """BC4 blocks of uint8 `[height, width]`, uint64 `[blocks]`: from the largest code to the smallest in 7 steps.

    A block is both ends, then the texels' indices of 3 bits by rows: 0 and 1 are the ends, 2 to 7 lie between them.
    """
    height, width = codes.shape
    texels = codes.reshape(height // 4, 4, width // 4, 4).swapaxes(1, 2).reshape(-1, 16).astype(np.uint64)
    most, least = texels.max(axis=1), texels.min(axis=1)
    span = np.maximum(most - least, 1)[:, None]
    steps = (14 * (most[:, None] - texels) + span) // (2 * span)  # rounded, 0 to 7
    indices = np.array([0, 2, 3, 4, 5, 6, 7, 1], np.uint64)[steps.astype(np.intp)]
    shifts = np.arange(16, 64, 3, dtype=np.uint64)
    return most | least << np.uint64(8) | np.bitwise_or.reduce(indices << shifts, axis=1)

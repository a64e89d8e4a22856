"""Latents in BC1 blocks by another decoder and a bilinear filter in float64."""

import numpy as np
import texture2ddecoder


def decoded(spec, blocks, g, mip):
    """Codes, float64 [rows, columns, 3], by texture2ddecoder. blocks: as of `BlockState`."""
    rows, columns = spec.latents(mip, g)
    data = texture2ddecoder.decode_bc1(blocks[g][mip].astype("<u4").tobytes(), columns, rows)
    return np.frombuffer(data, np.uint8).reshape(rows, columns, 4)[..., 2::-1].astype(np.float64)


def line(texels, latents):
    """Weights of latents for the texels along a side, [texels, latents]."""
    x = (np.arange(texels) + 0.5) * latents / texels - 0.5
    left = np.floor(x).astype(int)
    weights = np.zeros((texels, latents))
    np.add.at(weights, (np.arange(texels), left % latents), 1 - (x - left))
    np.add.at(weights, (np.arange(texels), (left + 1) % latents), x - left)
    return weights


def bilinear(values, uv):
    """[rows, columns, n] at uv [points, 2], wrapping."""
    rows, columns = values.shape[:2]
    x, y = uv[:, 0] * columns - 0.5, uv[:, 1] * rows - 0.5
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - left)[:, None], (y - top)[:, None]

    def at(i, j):
        return values[i % rows, j % columns]

    upper = (1 - fx) * at(top, left) + fx * at(top, left + 1)
    return (1 - fy) * upper + fy * ((1 - fx) * at(top + 1, left) + fx * at(top + 1, left + 1))

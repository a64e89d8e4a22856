"""Texels of block formats in kernels are those of an independent decoder, to the last bit."""

from functools import cache

import etcpak
import numpy as np
import pytest
import texture2ddecoder
import warp as wp
from skimage import data

from warp_neural.kernels.texture import block_formats

CHANNELS = {"bc1": 3, "bc3": 4, "bc4": 1, "bc5": 2, "bc7": 4}
RNG = np.random.default_rng(5)
ROWS, COLUMNS = 16, 24  # blocks


@cache
def make_kernel(format):
    read, channels = getattr(block_formats, f"{format}_texel"), CHANNELS[format]

    @wp.kernel(module="unique", enable_backward=False)
    def kernel(blocks: wp.array[wp.uint32], first: int, columns: int, codes: wp.array3d[int]):
        i, j = wp.tid()
        code = read(blocks, first, columns, i, j)
        if wp.static(channels == 1):
            codes[i, j, 0] = code
        else:
            for c in range(channels):
                codes[i, j, c] = code[c]

    return kernel


def decode(blocks, format, device, rows=ROWS, columns=COLUMNS):
    """By the kernel: codes [4 rows, 4 columns, channels] of blocks after three words that are no part of them."""
    words = np.concatenate([RNG.integers(0, 2**32, 3, np.uint32), np.frombuffer(blocks, np.uint32)])
    codes = wp.zeros((4 * rows, 4 * columns, CHANNELS[format]), dtype=int, device=device)
    inputs = [wp.array(words, device=device), 3, columns, codes]
    wp.launch(make_kernel(format), codes.shape[:2], inputs, device=device)
    return codes.numpy()


def expected(blocks, format, rows=ROWS, columns=COLUMNS):
    pixels = getattr(texture2ddecoder, f"decode_{format}")(blocks, 4 * columns, 4 * rows)
    codes = np.frombuffer(pixels, np.uint8).reshape(4 * rows, 4 * columns, 4)[..., [2, 1, 0, 3]]
    return codes[..., : CHANNELS[format]]


def random_blocks(format):
    size = 4 * block_formats.WORDS[format]
    return RNG.integers(0, 256, (ROWS * COLUMNS, size), np.uint8)


@pytest.mark.parametrize("format", ["bc1", "bc4", "bc5"])
def test_random_blocks(format, device):
    blocks = random_blocks(format).tobytes()
    assert (decode(blocks, format, device) == expected(blocks, format)).all()


def test_colours_of_bc3_have_no_black(device):
    """The decoder reads both orders of ends as in BC1; Microsoft's BC3 does not."""
    blocks = random_blocks("bc3")
    swapped = blocks.copy()
    swapped[:, 8:12] = blocks[:, [10, 11, 8, 9]]
    swapped[:, 12:] ^= 0b01010101  # index 0 with 1, 2 with 3
    ends = blocks[:, 8:12].copy().view(np.uint16)
    plain = np.where((ends[:, 0] > ends[:, 1])[:, None], blocks, swapped)
    assert (ends[:, 0] != ends[:, 1]).all() and (plain != blocks).any()
    assert (decode(blocks.tobytes(), "bc3", device) == expected(plain.tobytes(), "bc3")).all()


@pytest.mark.parametrize("mode", range(8))
def test_random_blocks_of_each_mode_of_bc7(mode, device):
    blocks = random_blocks("bc7")
    blocks[:, 0] = blocks[:, 0] & 255 - (2 << mode) + 1 | 1 << mode
    found = decode(blocks.tobytes(), "bc7", device)
    assert (found == expected(blocks.tobytes(), "bc7")).all()
    assert len(np.unique(found)) > 60


def test_a_block_of_bc7_without_mode_is_black(device):
    blocks = random_blocks("bc7")
    blocks[:, 0] = 0
    assert not decode(blocks.tobytes(), "bc7", device).any()


PICTURES = {
    "smooth": np.pad(data.astronaut()[100:164, 180:276], ((0, 0), (0, 0), (0, 1)), constant_values=255),
    "alpha": np.dstack([data.astronaut()[:64, :96], np.add.outer(np.arange(64), np.arange(96)).astype(np.uint8)]),
    "random": RNG.integers(0, 256, (64, 96, 4), np.uint8),
}


@pytest.mark.parametrize("picture", PICTURES)
def test_pictures_that_etcpak_encoded(picture, device):
    codes = PICTURES[picture]
    encoded = {
        "bc1": etcpak.compress_bc1(codes.tobytes(), 96, 64),
        "bc3": etcpak.compress_bc3(codes.tobytes(), 96, 64),
        "bc7": etcpak.compress_bc7(codes.tobytes(), 96, 64, etcpak.BC7CompressBlockParams()),
    }
    for format, blocks in encoded.items():
        assert (decode(blocks, format, device) == expected(blocks, format)).all(), format


@pytest.mark.parametrize("format", CHANNELS)
def test_compiles_for_hopper(format, tmp_path):
    (artifact,) = wp.compile_aot_module(make_kernel(format).module, arch=90, module_dir=tmp_path)
    assert artifact.stat().st_size > 0

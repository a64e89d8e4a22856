"""Texels of the block formats of GPUs, in any thread of any kernel: BC1, BC3, BC4, BC5 and all modes of BC7.

Blocks of 4 x 4 texels lie by rows, as in DDS files, in 32-bit words: 2 of BC1 and BC4, 4 of the others. Every
`..._texel(blocks, first, columns, i, j)` reads row i, column j of the picture whose blocks begin at word `first`,
`columns` of them a row, and returns codes, 0 to 255, linear or sRGB as they were encoded.

Microsoft, "Texture Block Compression in Direct3D 11", "BC7 Format" and "BC7 Format Mode Reference". For BC1 to BC5
these give fractions; here integers are divided and rounded down, ends of 5 and 6 bits repeat their high bits below.
BC1: (2 a + b) / 3, (a + 2 b) / 3, or, if a <= b, (a + b) / 2 and black; BC3's colours the first two always. BC4:
((7 - k) a + k b) / 7, k = 1 to 6, or, if a <= b, ((5 - k) a + k b) / 5, k = 1 to 4, 0 and 255. GPUs may differ by one
there; BC7, ((64 - w) a + w b + 32) / 64, is exact everywhere.
"""

from pathlib import Path

import warp as wp

from warp_neural.kernels.native import paste

WORDS = {"bc1": 2, "bc3": 4, "bc4": 2, "bc5": 4, "bc7": 4}
"""of a block"""

# of BC7, a hexadecimal digit a mode, mode 0 rightmost
_SUBSETS, _PARTITION_BITS, _ROTATION_BITS, _SELECTOR_BITS = 0x21112323, 0x60006664, 0x00220000, 0x00010000
_COLOUR_BITS, _ALPHA_BITS, _OWN_PARITY, _SHARED_PARITY = 0x57757564, 0x57860000, 0x11001001, 0x00000010
_INDEX_BITS, _SECOND_INDEX_BITS = 0x24222233, 0x00230000
_SHAPES = paste(Path(__file__).parent / "native" / "bc7_shapes.h")


@wp.func
def word_of_block(first: int, columns: int, i: int, j: int, words: int) -> int:
    """Where the block of row i, column j begins."""
    return first + (i / 4 * columns + j / 4) * words


@wp.func
def texel_of_block(i: int, j: int) -> int:
    """0 to 15, by rows."""
    return i % 4 * 4 + j % 4


@wp.func
def expand_565(colour: int) -> wp.vec3i:
    red, green, blue = colour >> 11, colour >> 5 & 63, colour & 31
    return wp.vec3i(red << 3 | red >> 2, green << 2 | green >> 4, blue << 3 | blue >> 2)


@wp.func
def bc1_colour(ends: wp.uint32, indices: wp.uint32, texel: int, three: bool) -> wp.vec3i:
    """Of the two words of a block. three: a block with a <= b has three colours and black."""
    first, second = int(ends & wp.uint32(0xFFFF)), int(ends >> wp.uint32(16))
    a, b = expand_565(first), expand_565(second)
    index = int(indices >> wp.uint32(2 * texel)) & 3
    if index == 0:
        return a
    if index == 1:
        return b
    if three and first <= second:
        return wp.where(index == 2, (a + b) / 2, wp.vec3i())
    return wp.where(index == 2, (2 * a + b) / 3, (a + 2 * b) / 3)


@wp.func
def bc4_value(low: wp.uint32, high: wp.uint32, texel: int) -> int:
    """Of the two words of a block."""
    a, b = int(low & wp.uint32(255)), int(low >> wp.uint32(8) & wp.uint32(255))
    bits = (wp.uint64(high) << wp.uint64(32) | wp.uint64(low)) >> wp.uint64(16 + 3 * texel)
    index = int(bits & wp.uint64(7))
    if index < 2:
        return wp.where(index == 0, a, b)
    if a > b:
        return ((8 - index) * a + (index - 1) * b) / 7
    if index < 6:
        return ((6 - index) * a + (index - 1) * b) / 5
    return (index - 6) * 255


@wp.func
def bc1_texel(blocks: wp.array[wp.uint32], first: int, columns: int, i: int, j: int) -> wp.vec3i:
    """Red, green, blue; black where the format says transparent."""
    at = word_of_block(first, columns, i, j, 2)
    return bc1_colour(blocks[at], blocks[at + 1], texel_of_block(i, j), True)


@wp.func
def bc3_texel(blocks: wp.array[wp.uint32], first: int, columns: int, i: int, j: int) -> wp.vec4i:
    """Red, green, blue, alpha."""
    at, texel = word_of_block(first, columns, i, j, 4), texel_of_block(i, j)
    colour = bc1_colour(blocks[at + 2], blocks[at + 3], texel, False)
    return wp.vec4i(colour[0], colour[1], colour[2], bc4_value(blocks[at], blocks[at + 1], texel))


@wp.func
def bc4_texel(blocks: wp.array[wp.uint32], first: int, columns: int, i: int, j: int) -> int:
    at = word_of_block(first, columns, i, j, 2)
    return bc4_value(blocks[at], blocks[at + 1], texel_of_block(i, j))


@wp.func
def bc5_texel(blocks: wp.array[wp.uint32], first: int, columns: int, i: int, j: int) -> wp.vec2i:
    """Red, green."""
    at, texel = word_of_block(first, columns, i, j, 4), texel_of_block(i, j)
    red = bc4_value(blocks[at], blocks[at + 1], texel)
    return wp.vec2i(red, bc4_value(blocks[at + 2], blocks[at + 3], texel))


@wp.func
def bits_of(low: wp.uint64, high: wp.uint64, start: int, count: int) -> int:
    """`count` bits, at most 8, of 128 from bit `start` on; 0 beyond the last."""
    bits = high >> wp.uint64(wp.max(start - 64, 0))
    if start < 64:
        bits = low >> wp.uint64(start)
        if start > 56:
            bits = bits | high << wp.uint64(64 - start)
    return int(bits & ((wp.uint64(1) << wp.uint64(count)) - wp.uint64(1)))


@wp.func
def of_mode(digits: wp.uint32, mode: int) -> int:
    return int(digits >> wp.uint32(4 * mode)) & 15


@wp.func_native(_SHAPES + "return (int)(shapes[shape] >> 2 * texel & 3u);\n")
def bc7_subset(shape: int, texel: int) -> int: ...


@wp.func_native(_SHAPES + "return anchors[shape];\n")
def bc7_anchors(shape: int) -> int: ...


@wp.func
def bc7_ends(low: wp.uint64, high: wp.uint64, mode: int, start: int, subset: int, channel: int) -> wp.vec2i:
    """Both ends of a channel (red, green, blue, alpha: 0 to 3), in 8 bits. start: the bit where the colours begin."""
    subsets, bits = of_mode(wp.uint32(_SUBSETS), mode), of_mode(wp.uint32(_COLOUR_BITS), mode)
    alpha_bits = of_mode(wp.uint32(_ALPHA_BITS), mode)
    at, parities = start + channel * 2 * subsets * bits, start + 2 * subsets * (3 * bits + alpha_bits)
    bits = wp.where(channel == 3, alpha_bits, bits)
    ends = wp.vec2i(255, 255)
    if bits > 0:
        own, shared = of_mode(wp.uint32(_OWN_PARITY), mode), of_mode(wp.uint32(_SHARED_PARITY), mode)
        for e in range(2):
            end = bits_of(low, high, at + (2 * subset + e) * bits, bits)
            if own + shared > 0:
                end = end << 1 | bits_of(low, high, parities + wp.where(own > 0, 2 * subset + e, subset), 1)
            size = bits + own + shared
            ends[e] = end << (8 - size) | end >> (2 * size - 8)
    return ends


@wp.func
def bc7_weight(low: wp.uint64, high: wp.uint64, start: int, bits: int, texel: int, lacking: int, anchor: bool) -> int:
    """Of the second end, in 64ths. start: of all indices; lacking: texels before this one with a bit less."""
    index = bits_of(low, high, start + texel * bits - lacking, bits - int(anchor))
    steps = (1 << bits) - 1
    return (128 * index + steps) / (2 * steps)


@wp.func
def rotated(colour: wp.vec4i, rotation: int) -> wp.vec4i:
    """Alpha in place of red, green or blue: 1, 2 or 3."""
    result = wp.vec4i(colour)
    if rotation > 0:
        result[rotation - 1] = colour[3]
        result[3] = colour[rotation - 1]
    return result


@wp.func
def bc7_colour(low: wp.uint64, high: wp.uint64, texel: int) -> wp.vec4i:
    """Of the two halves of a block; 0 where the format says that no mode is."""
    mode = int(0)
    while mode < 8 and bits_of(low, high, mode, 1) == 0:
        mode += 1
    if mode == 8:
        return wp.vec4i()
    subsets, at = of_mode(wp.uint32(_SUBSETS), mode), mode + 1
    partition = bits_of(low, high, at, of_mode(wp.uint32(_PARTITION_BITS), mode))
    at += of_mode(wp.uint32(_PARTITION_BITS), mode)
    rotation = bits_of(low, high, at, of_mode(wp.uint32(_ROTATION_BITS), mode))
    at += of_mode(wp.uint32(_ROTATION_BITS), mode)
    selector = bits_of(low, high, at, of_mode(wp.uint32(_SELECTOR_BITS), mode))
    at += of_mode(wp.uint32(_SELECTOR_BITS), mode)

    subset, lacking, anchor = int(0), wp.min(texel, 1), texel == 0
    if subsets > 1:
        shape = partition + 64 * (subsets - 2)
        subset = bc7_subset(shape, texel)
        second, third = bc7_anchors(shape) & 15, bc7_anchors(shape) >> 4
        lacking += int(second < texel) + int(subsets > 2 and third < texel)
        anchor = anchor or texel == second or (subsets > 2 and texel == third)
    bits, second_bits = of_mode(wp.uint32(_INDEX_BITS), mode), of_mode(wp.uint32(_SECOND_INDEX_BITS), mode)
    indices = 128 - 16 * (bits + second_bits) + subsets + wp.min(second_bits, 1)
    weight = bc7_weight(low, high, indices, bits, texel, lacking, anchor)
    alpha_weight = weight
    if second_bits > 0:
        alpha_weight = bc7_weight(low, high, indices + 16 * bits - 1, second_bits, texel, wp.min(texel, 1), texel == 0)
    if selector == 1:
        weight, alpha_weight = alpha_weight, weight

    colour = wp.vec4i()
    for channel in range(4):
        ends = bc7_ends(low, high, mode, at, subset, channel)
        w = wp.where(channel == 3, alpha_weight, weight)
        colour[channel] = ((64 - w) * ends[0] + w * ends[1] + 32) >> 6
    return rotated(colour, rotation)


@wp.func
def bc7_texel(blocks: wp.array[wp.uint32], first: int, columns: int, i: int, j: int) -> wp.vec4i:
    """Red, green, blue, alpha."""
    at = word_of_block(first, columns, i, j, 4)
    low = wp.uint64(blocks[at + 1]) << wp.uint64(32) | wp.uint64(blocks[at])
    high = wp.uint64(blocks[at + 3]) << wp.uint64(32) | wp.uint64(blocks[at + 2])
    return bc7_colour(low, high, texel_of_block(i, j))

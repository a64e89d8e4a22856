"""Kernels of the entropy coder of `.wntc` files: blocks of latents, and numbers each by a table of its own.

Native text in `native/*.h`, C but for these kernels' first lines; docs/wntc.md has the format. tables: all tables one
after the other, with where each begins in offsets, and the end; zeros: as `each_latent.h` has them; context: of a grid,
its numbers in their order. latents, parents: [cells of all mips, channels]. blocks: of each its first row and column,
the rows and columns of its mip, those of the parents, the first cell of the mip and of its parents, and, to decode, the
first byte and the bytes in data.
"""

from functools import cache
from pathlib import Path

import warp as wp

from warp_neural.kernels.native import constant, paste

NATIVE = Path(__file__).parent / "native"
LATENT_BITS, NUMBER_BITS = 8, 16  # of a symbol that no table has
TABLES = 480  # of latents
AFTER, AFTER_ALL = 8, 32  # entries of 0xFFFF after each table, and after all: they are read at once, not one by one

PLACE = 10  # numbers of a block: `_LATENTS`

_LATENTS = """
const int* const place = blocks.data + PLACE * block;
const int row = place[0], column = place[1], rows = place[2], columns = place[3];
const int parent_rows = place[4], parent_columns = place[5], channels = latents_.shape[1];
const int parent_channels = parents_.shape[1];
signed char* const latents = (signed char*)latents_.data + (long long)place[6] * channels;
const signed char* const parents = (const signed char*)parents_.data + (long long)place[7] * parent_channels;
const int* const context = context_.data;
const unsigned short* const tables = tables_.data;
const int* const offsets = offsets_.data;
const int* const zeros = zeros_.data;
int* const space = space_.data + space_.shape[1] * which_space;
const int row_end = row + side < rows ? row + side : rows;
const int column_end = column + side < columns ? column + side : columns;
"""
_NUMBERS = """
const unsigned short* const tables = tables_.data;
for (int i = 0; i < (int)numbers.shape[0]; ++i) {
    const int begin = offsets.data[which.data[i]], last = offsets.data[which.data[i] + 1] - 1 - AFTER - begin;
    const int centre = 0, phase = 0;
    const unsigned short* const table = tables + begin;
    int value = numbers.data[i];
    CODE
    numbers.data[i] = value;
}
"""
_READ = "const unsigned char *at = data.data + first, *const end = at + size;\n" + paste(NATIVE / "start_decoding.h")
_BYTES = (
    constant("PLACE", PLACE)
    + """
const int first = blocks.data[PLACE * block + 8], size = blocks.data[PLACE * block + 9];
"""
)
_WRITE = "unsigned* const notes = notes_.data;\nint count = 0;\n"
_FINISH = "unsigned char* const bytes_end = bytes.data + bytes.shape[0];\n" + paste(NATIVE / "write_notes.h")
_WHOLE = "return damaged || state != 1u << 23 || at != end;\n"


def space_words(side: int) -> int:
    return 56 * side + 72


def _symbol(name: str, bits: int) -> str:
    return f"{{\n{paste(NATIVE / name, RAW_BITS=bits)}}}\n"


def _each_latent(code: str, zero: str = "") -> str:
    text = paste(NATIVE / "each_latent.h", TABLES=TABLES, AFTER=AFTER)
    text = text.replace("                ZERO\n", zero).replace("                CODE\n", code)
    return _LATENTS + paste(NATIVE / "lanes.h") + text


def _each_number(name: str) -> str:
    return constant("AFTER", AFTER) + _NUMBERS.replace("    CODE\n", _symbol(name, NUMBER_BITS))


_DECODE_LATENT = "int value;\n" + _symbol("decode_symbol.h", LATENT_BITS)
_DECODE_LATENT += "here[c] = (signed char)value;\nlatent = (signed char)value;\n"
_NOTE_LATENT = "const int value = here[c], last = offsets[w + 1] - 1 - AFTER - offsets[w];\nlatent = value;\n"
_NOTE_LATENT += _symbol("note_symbol.h", LATENT_BITS)


@cache
def decode_blocks_kernel() -> wp.Kernel:
    """Thread i decodes block i of a grid, in CUDA warp i; lanes: of it, 1 or 32. latents: zeros. damaged: 1 where a
    stream does not end as it must."""

    @wp.func_native(_BYTES + _READ + _each_latent(_DECODE_LATENT, paste(NATIVE / "decode_zero.h")) + _WHOLE)
    def decode(
        data: wp.array[wp.uint8], blocks: wp.array2d[int], block: int, side: int, ratio: int,
        latents_: wp.array2d[wp.int8], parents_: wp.array2d[wp.int8], context_: wp.array[int],
        tables_: wp.array[wp.uint16], offsets_: wp.array[int], zeros_: wp.array[int], space_: wp.array2d[int],
        which_space: int,
    ) -> int: ...  # fmt: skip

    @wp.kernel(module="unique", enable_backward=False)
    def decode_blocks(
        data: wp.array[wp.uint8], blocks: wp.array2d[int], side: int, ratio: int, latents: wp.array2d[wp.int8],
        parents: wp.array2d[wp.int8], context: wp.array[int], tables: wp.array[wp.uint16], offsets: wp.array[int],
        zeros: wp.array[int], space: wp.array2d[int], lanes: int, damaged: wp.array[int],
    ):  # fmt: skip
        i = wp.tid() // lanes
        damaged[i] = decode(
            data, blocks, i, side, ratio, latents, parents, context, tables, offsets, zeros, space, i
        )  # fmt: skip

    return decode_blocks


@cache
def encode_block_kernel() -> wp.Kernel:
    """One thread writes a block to the end of bytes; size: its bytes. notes: two words a latent; bytes: three a note,
    and four."""

    @wp.func_native(constant("PLACE", PLACE) + _WRITE + _each_latent(_NOTE_LATENT) + _FINISH + "return size;\n")
    def encode(
        bytes: wp.array[wp.uint8], notes_: wp.array[wp.uint32], blocks: wp.array2d[int], block: int, side: int,
        ratio: int, latents_: wp.array2d[wp.int8], parents_: wp.array2d[wp.int8], context_: wp.array[int],
        tables_: wp.array[wp.uint16], offsets_: wp.array[int], zeros_: wp.array[int], space_: wp.array2d[int],
        which_space: int,
    ) -> int: ...  # fmt: skip

    @wp.kernel(module="unique", enable_backward=False)
    def encode_block(
        bytes: wp.array[wp.uint8], notes: wp.array[wp.uint32], blocks: wp.array2d[int], block: int, side: int,
        ratio: int, latents: wp.array2d[wp.int8], parents: wp.array2d[wp.int8], context: wp.array[int],
        tables: wp.array[wp.uint16], offsets: wp.array[int], zeros: wp.array[int], space: wp.array2d[int],
        size: wp.array[int],
    ):  # fmt: skip
        size[0] = encode(
            bytes, notes, blocks, block, side, ratio, latents, parents, context, tables, offsets, zeros, space, 0
        )  # fmt: skip

    return encode_block


@cache
def numbers_kernels() -> tuple[wp.Kernel, wp.Kernel]:
    """(decode, encode): one thread for all numbers, number i by table which[i]."""

    @wp.func_native("const int first = 0, size = data.shape[0];\n" + _READ + _each_number("decode_symbol.h") + _WHOLE)
    def decode(
        data: wp.array[wp.uint8], numbers: wp.array[int], which: wp.array[int], tables_: wp.array[wp.uint16],
        offsets: wp.array[int],
    ) -> int: ...  # fmt: skip

    @wp.func_native(_WRITE + _each_number("note_symbol.h") + _FINISH + "return size;\n")
    def encode(
        bytes: wp.array[wp.uint8], notes_: wp.array[wp.uint32], numbers: wp.array[int], which: wp.array[int],
        tables_: wp.array[wp.uint16], offsets: wp.array[int],
    ) -> int: ...  # fmt: skip

    @wp.kernel(module="unique", enable_backward=False)
    def decode_numbers(
        data: wp.array[wp.uint8], numbers: wp.array[int], which: wp.array[int], tables: wp.array[wp.uint16],
        offsets: wp.array[int], damaged: wp.array[int],
    ):  # fmt: skip
        damaged[0] = decode(data, numbers, which, tables, offsets)

    @wp.kernel(module="unique", enable_backward=False)
    def encode_numbers(
        bytes: wp.array[wp.uint8], notes: wp.array[wp.uint32], numbers: wp.array[int], which: wp.array[int],
        tables: wp.array[wp.uint16], offsets: wp.array[int], size: wp.array[int],
    ):  # fmt: skip
        size[0] = encode(bytes, notes, numbers, which, tables, offsets)

    return decode_numbers, encode_numbers

"""Kernels of the entropy coder of `.wntc` files: blocks of latents, and numbers each by a table of its own.

Native text in `native/*.h`, C but for these kernels' first lines; docs/wntc.md has the format. tables: all tables one
after the other, with where each begins in offsets, and the end; zeros: as `each_latent.h` has them; context: of a grid,
its numbers in their order.
"""

from functools import cache
from pathlib import Path

import warp as wp

from warp_neural.kernels.native import constant, paste

NATIVE = Path(__file__).parent / "native"
LATENT_BITS, NUMBER_BITS = 8, 16  # of a symbol that no table has
TABLES = 480  # of latents
AFTER, AFTER_ALL = 8, 32  # entries of 0xFFFF after each table, and after all: they are read at once, not one by one

_LATENTS = """
signed char* const latents = (signed char*)latents_.data;
const signed char* const parents = (const signed char*)parents_.data;
const int* const context = context_.data;
const unsigned short* const tables = tables_.data;
const int* const offsets = offsets_.data;
const int* const zeros = zeros_.data;
int* const space = space_.data + space_.shape[1] * which_space;
const int rows = latents_.shape[0], columns = latents_.shape[1], channels = latents_.shape[2];
const int parent_rows = parents_.shape[0], parent_columns = parents_.shape[1], parent_channels = parents_.shape[2];
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
    """Thread i decodes block i of a grid, in CUDA warp i; lanes: of it, 1 or 32. blocks: its first row and column,
    first byte and bytes in data. latents: zeros, [rows, columns, channels]. damaged: 1 where a stream does not end as
    it must."""

    @wp.func_native(_READ + _each_latent(_DECODE_LATENT, paste(NATIVE / "decode_zero.h")) + _WHOLE)
    def decode(
        data: wp.array[wp.uint8], first: int, size: int, row: int, column: int, side: int, ratio: int,
        latents_: wp.array3d[wp.int8], parents_: wp.array3d[wp.int8], context_: wp.array[int],
        tables_: wp.array[wp.uint16], offsets_: wp.array[int], zeros_: wp.array[int], space_: wp.array2d[int],
        which_space: int,
    ) -> int: ...  # fmt: skip

    @wp.kernel(module="unique", enable_backward=False)
    def decode_blocks(
        data: wp.array[wp.uint8], blocks: wp.array2d[int], side: int, ratio: int, latents: wp.array3d[wp.int8],
        parents: wp.array3d[wp.int8], context: wp.array[int], tables: wp.array[wp.uint16], offsets: wp.array[int],
        zeros: wp.array[int], space: wp.array2d[int], lanes: int, damaged: wp.array[int],
    ):  # fmt: skip
        i = wp.tid() // lanes
        row, column, first, size = blocks[i, 0], blocks[i, 1], blocks[i, 2], blocks[i, 3]
        damaged[i] = decode(
            data, first, size, row, column, side, ratio, latents, parents, context, tables, offsets, zeros, space, i
        )  # fmt: skip

    return decode_blocks


@cache
def encode_block_kernel() -> wp.Kernel:
    """One thread writes the block that begins at row and column to the end of bytes; size: its bytes. notes: two words
    a latent; bytes: three a note, and four."""

    @wp.func_native(_WRITE + _each_latent(_NOTE_LATENT) + _FINISH + "return size;\n")
    def encode(
        bytes: wp.array[wp.uint8], notes_: wp.array[wp.uint32], row: int, column: int, side: int, ratio: int,
        latents_: wp.array3d[wp.int8], parents_: wp.array3d[wp.int8], context_: wp.array[int],
        tables_: wp.array[wp.uint16], offsets_: wp.array[int], zeros_: wp.array[int], space_: wp.array2d[int],
        which_space: int,
    ) -> int: ...  # fmt: skip

    @wp.kernel(module="unique", enable_backward=False)
    def encode_block(
        bytes: wp.array[wp.uint8], notes: wp.array[wp.uint32], row: int, column: int, side: int, ratio: int,
        latents: wp.array3d[wp.int8], parents: wp.array3d[wp.int8], context: wp.array[int],
        tables: wp.array[wp.uint16], offsets: wp.array[int], zeros: wp.array[int], space: wp.array2d[int],
        size: wp.array[int],
    ):  # fmt: skip
        size[0] = encode(
            bytes, notes, row, column, side, ratio, latents, parents, context, tables, offsets, zeros, space, 0
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

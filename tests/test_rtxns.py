"""RTXNS's binary network files: round trips bit for bit, a C++ reader of the layout, damaged files of any kind."""

import shutil
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rtxns_files import check, network, quiet, same

from warp_neural.errors import InputError
from warp_neural.io.rtxns import read_binary, write_binary
from warp_neural.io.rtxns_json import read_json

HEADER = 304


def uniform_sizes():
    size = st.integers(1, 40)
    return st.builds(lambda k, n, depth, m: (k, *[n] * depth, m), size, size, st.integers(0, 7), size)


@quiet
@given(uniform_sizes(), st.sampled_from([np.float16, np.float32]), st.booleans(), st.integers(0, 99))
def test_binary_returns_bit_for_bit(tmp_path, sizes, dtype, column_major, seed):
    net = network(sizes, dtype, seed)
    write_binary(tmp_path / "a.bin", net, precision=np.dtype(dtype).name, column_major=column_major)
    same(read_binary(tmp_path / "a.bin"), net)
    assert (tmp_path / "a.bin").stat().st_size % 64 == HEADER % 64


@pytest.fixture(scope="session")
def cpp_reader(tmp_path_factory):
    compiler = shutil.which("g++") or shutil.which("clang++")
    if not compiler:
        pytest.skip("no C++ compiler (g++ or clang++) on this machine")
    program = tmp_path_factory.mktemp("reader") / "reader"
    source = Path(__file__).parent / "rtxns_reader.cpp"
    subprocess.run([compiler, "-std=c++17", "-Wall", "-Werror", "-o", program, source], check=True)
    return program


@pytest.mark.parametrize("column_major", [False, True])
@pytest.mark.parametrize("dtype", [np.float16, np.float32])
@pytest.mark.parametrize("sizes", [(30, 32, 32, 32, 4), (3, 2), (1, *[5] * 7, 9)])
def test_a_cpp_reader_of_the_layout_reads_every_weight(tmp_path, cpp_reader, sizes, dtype, column_major):
    net = network(sizes, dtype)
    net.weights[0].ravel()[:3] = [-0.0, np.finfo(dtype).max, np.finfo(dtype).smallest_subnormal]
    write_binary(tmp_path / "a.bin", net, precision=np.dtype(dtype).name, column_major=column_major)
    lines = subprocess.run([cpp_reader, tmp_path / "a.bin"], check=True, capture_output=True, text=True).stdout.split(
        "\n"
    )
    assert int(lines[0]) == len(sizes) - 1
    for index, (weights, biases) in enumerate(zip(net.weights, net.biases, strict=True)):
        assert lines[1 + 2 * index].split() == [str(n) for n in sizes[index : index + 2]]
        expected = np.hstack([weights.ravel(), biases]).astype(np.float32).view(np.uint32)
        assert [int(word) for word in lines[2 + 2 * index].split()] == expected.tolist()


def as_rtxns_writes(net, align_bias=16, pad=True):
    """The bytes of RTXNS's own writer, field by field: filler is whatever was in memory."""
    head, data = bytearray(HEADER), bytearray()
    sizes = net.sizes
    struct.pack_into(
        "<5I2i4s", head, 0, 0xA1C0DE01, len(sizes) - 2, sizes[0], sizes[1], sizes[-1], 0, 0, b"\xcd\xab\1\2"
    )
    for index, (weights, biases) in enumerate(zip(net.weights, net.biases, strict=True)):
        data += bytes(-len(data) % 64)
        start = len(data)
        data += weights.tobytes()
        data += bytes(-len(data) % align_bias)
        record = (*weights.T.shape, weights.nbytes, biases.nbytes, start, len(data))
        struct.pack_into("<2I2Q2I", head, 32 + 32 * index, *record)
        data += biases.tobytes()
    data += bytes(-len(data) % 64 if pad else 0)
    struct.pack_into("<i4sQ", head, 288, 0, b"\xff" * 4, len(data))
    return bytes(head + data)


@pytest.mark.parametrize("pad", [False, True])
@pytest.mark.parametrize("align_bias", [16, 64])
def test_files_as_rtxns_writes_them_load(tmp_path, align_bias, pad):
    net = network((5, 12, 12, 3))  # biases that 16 and 64 bytes place differently
    (tmp_path / "a.bin").write_bytes(as_rtxns_writes(net, align_bias, pad))
    same(read_binary(tmp_path / "a.bin"), net)


def test_a_padded_file_whose_header_counts_no_padding_loads(tmp_path):
    data = as_rtxns_writes(network(), pad=False)
    (tmp_path / "a.bin").write_bytes(data + bytes(-(len(data) - HEADER) % 64))
    same(read_binary(tmp_path / "a.bin"), network())


def patched(offset, fmt, *values):
    data = bytearray(as_rtxns_writes(network()))
    struct.pack_into(fmt, data, offset, *values)
    return bytes(data)


WHOLE = as_rtxns_writes(network())  # 5-16-16-3, float16: weights at 0, biases at 160, weights at 192 ...
REFUSED = {
    "empty": (b"", "begins with 0x00000000"),
    "magic": (patched(0, "<I", 0xA1C0DF01), "begins with 0xA1C0DF01, not 0xA1C0DE01"),
    "version": (patched(0, "<I", 0xA1C0DE02), "version 2, only 1 is known"),
    "cut header": (WHOLE[:303], "header: cut short at 303 of 304"),
    "cut data": (WHOLE[:-1], "data bytes: .* where the file has"),
    "oversized": (WHOLE + b"\0", "data bytes: .* where the file has"),
    "oversized by a block": (WHOLE + bytes(64), "data bytes: .* where the file has"),
    "hidden layers": (patched(4, "<I", 8), "hidden layers: 8, at most 7"),
    "fewer hidden layers": (patched(4, "<I", 1), "layer 1 outputs: 16, where the header needs 3"),
    "more hidden layers": (patched(4, "<I", 3), "layer 2 outputs: 3, where the header needs 16"),
    "inputs": (patched(8, "<I", 6), "layer 0 inputs: 5, where the header needs 6"),
    "hidden neurons": (patched(12, "<I", 17), "layer 0 outputs: 16, where the header needs 17"),
    "outputs": (patched(16, "<I", 2**32 - 1), "layer 2 outputs: 3, where the header needs 4294967295"),
    "nothing": (patched(8, "<I", 0)[:32] + bytes(4) + WHOLE[36:], "layer 0 inputs: none"),
    "weight precision": (patched(20, "<i", 2), "weight precision: 2"),
    "bias precision": (patched(24, "<i", -1), "bias precision: -1"),
    "other precision": (patched(20, "<i", 1), "layer 0 weight bytes: 160, where the header needs 320"),
    "weight bytes": (patched(40, "<Q", 2**64 - 1), "layer 0 weight bytes: 18446744073709551615"),
    "bias bytes": (patched(48, "<Q", 0), "layer 0 bias bytes: 0, where the header needs 32"),
    "alignment": (patched(56, "<I", 32), "layer 0 weights: offset 32 is not a multiple of 64"),
    "bias alignment": (patched(60, "<I", 168), "layer 0 biases: offset 168 is not a multiple of 64"),
    "outside": (patched(60, "<I", 2**32 - 64), "layer 0 biases: end at byte 4294967264 of the data"),
    "overlap": (patched(60, "<I", 192), "layer 1 weights: begin at byte 192 of the data, inside layer 0 biases"),
    "unused layer": (patched(32 + 7 * 32, "<I", 1), "layer 7: is in use, but the header has 3 layers"),
    "layout": (patched(288, "<i", 2), "matrix layout: 2"),
    "data bytes": (patched(296, "<Q", 2**63), "data bytes: 9223372036854775808, where the layers end at"),
    "NaN": (patched(HEADER, "<e", np.nan), "layer 0 weights: NaN or infinite"),
    "infinite": (patched(HEADER + 160, "<e", np.inf), "layer 0 biases: NaN or infinite"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_binary_files_name_the_field(tmp_path, case):
    data, message = REFUSED[case]
    path = tmp_path / "a.bin"
    path.write_bytes(data)
    with pytest.raises(InputError, match=message) as error:
        read_binary(path)
    assert str(error.value).startswith(f"{path}: ") and "\n" not in str(error.value)


def test_every_truncation_is_refused(tmp_path):
    path = tmp_path / "a.bin"
    for length in range(len(WHOLE)):
        path.write_bytes(WHOLE[:length])
        with pytest.raises(InputError):
            read_binary(path)


def test_what_the_binary_cannot_hold_is_refused(tmp_path):
    path = tmp_path / "a.bin"
    for sizes in ((2, 3, 4, 1), (2, *[3] * 8, 1)):
        with pytest.raises(InputError, match="use JSON"):
            write_binary(path, network(sizes))
    large = network((2, 1), np.float32)
    large.biases[0][:] = 65520.0  # rounds to an infinite half
    with pytest.raises(InputError, match=r"a\.bin: layer 0 has values beyond float16"):
        write_binary(path, large)
    assert not path.exists()


def test_missing_and_huge_files_are_refused(tmp_path):
    huge = tmp_path / "huge.bin"
    with open(huge, "wb") as file:
        file.truncate(2**40)  # takes no disk
    for read in (read_binary, read_json):
        with pytest.raises(InputError, match="larger than 64 MiB"):
            read(huge)
        with pytest.raises(InputError, match="no such file"):
            read(tmp_path / "none.bin")
        with pytest.raises(InputError, match="no such file"):
            read(tmp_path)


EXTREMES = st.sampled_from([0, 1, 2, 15, 63, 64, 2**16, 2**31 - 1, 2**31, 2**32 - 64, 2**32 - 1])


@quiet
@given(st.lists(st.tuples(st.integers(0, HEADER // 4 - 1), EXTREMES), min_size=1, max_size=3), st.booleans())
def test_extreme_header_fields_give_a_network_or_an_input_error(tmp_path, fields, column_major):
    write_binary(tmp_path / "a.bin", network(), column_major=column_major)
    data = bytearray((tmp_path / "a.bin").read_bytes())
    for word, value in fields:
        struct.pack_into("<I", data, 4 * word, value)
    check(read_binary, tmp_path / "a.bin", data)


@quiet
@given(st.lists(st.tuples(st.integers(min_value=0), st.integers(0, 255)), min_size=1, max_size=4))
def test_damaged_bytes_give_a_network_or_an_input_error(tmp_path, changes):
    content = bytearray(WHOLE)
    for place, value in changes:
        content[place % len(content)] = value
    check(read_binary, tmp_path / "a", content)


@quiet
@given(st.binary(max_size=400), st.booleans())
def test_random_bytes_give_a_network_or_an_input_error(tmp_path, content, magic):
    for read in (read_binary, read_json):
        check(read, tmp_path / "a", b"\x01\xde\xc0\xa1" * magic + content)

"""Arrays in safetensors: they return bit for bit, a full disk changes nothing, and no damaged file does harm."""

import errno
import json
import os
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_np

from warp_neural.errors import InputError
from warp_neural.io.tensors import load_tensors, save_tensors

quiet = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
numbers = st.one_of(
    st_np.floating_dtypes(endianness="<", sizes=(16, 32, 64)), st_np.integer_dtypes(), st.just(np.bool_)
)
arrays = numbers.flatmap(lambda dtype: st_np.arrays(dtype, st_np.array_shapes(min_dims=0, max_dims=4, min_side=0)))
objects = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


@quiet
@given(st.dictionaries(st.text(min_size=1).filter("__metadata__".__ne__), arrays, max_size=4), objects)
def test_arrays_and_metadata_return(tmp_path, tensors, value):
    save_tensors(tmp_path / "a.safetensors", tensors, {"value": value})
    loaded, metadata = load_tensors(tmp_path / "a.safetensors")
    assert metadata == {"value": value} and loaded.keys() == tensors.keys()
    for name, array in tensors.items():
        assert loaded[name].dtype == array.dtype.newbyteorder("=") and loaded[name].shape == array.shape
        assert loaded[name].tobytes() == array.astype(loaded[name].dtype).tobytes()


def test_strided_and_transposed_arrays_are_written_in_their_order(tmp_path):
    a = np.arange(24.0).reshape(4, 6)
    save_tensors(tmp_path / "a.safetensors", {"t": a.T, "s": a[::2, ::3], "0": np.float32(3)}, {})
    loaded, _ = load_tensors(tmp_path / "a.safetensors")
    assert (loaded["t"] == a.T).all() and (loaded["s"] == a[::2, ::3]).all() and loaded["0"].shape == ()
    loaded["t"][0, 0] = 1  # writable


def test_a_full_disk_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "a.safetensors"
    save_tensors(path, {"a": np.ones(3)}, {"old": True})

    def write(self, data):
        with open(self, "wb") as file:
            file.write(data[: len(data) // 2])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", write)
    with pytest.raises(InputError, match=r"a\.safetensors: could not be written \(No space left on device\)"):
        save_tensors(path, {"a": np.zeros(3)}, {})
    assert load_tensors(path)[1] == {"old": True} and [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize(
    ("tensors", "metadata", "message"),
    [
        ({"a": np.array(["x"])}, {}, "tensor 'a' of type <U1"),
        ({"a": np.array([None])}, {}, "tensor 'a' of type object"),
        ({}, {"a": np.float32(1)}, "metadata cannot be written as JSON"),
    ],
)
def test_what_cannot_be_written_is_named(tmp_path, tensors, metadata, message):
    with pytest.raises(InputError, match=message):
        save_tensors(tmp_path / "a.safetensors", tensors, metadata)
    assert not list(tmp_path.iterdir())


def encode(header, data=b"", length=None):
    header = header if isinstance(header, bytes) else json.dumps(header).encode()
    return struct.pack("<Q", len(header) if length is None else length) + header + data


def one(dtype="F32", shape=(2,), offsets=(0, 8), metadata="{}"):
    tensor = {"dtype": dtype, "shape": shape, "data_offsets": offsets}
    return {"__metadata__": {"warp_neural": metadata}, "a": tensor}


DAMAGED = {
    "empty": (b"", "header too small"),
    "huge header": (encode(b"{}", length=2**63), "header too large"),
    "long header": (encode(b"{}", length=90_000_000), "invalid header length"),
    "not JSON": (encode(b"\x80{}"), "UTF-8"),
    "nesting": (encode(b"[" * 100_000), "invalid JSON"),
    "foreign": (encode({"a": one()["a"]}, bytes(8)), "not written by Warp Neural"),
    "cut": (encode(one(), bytes(7)), "not a whole safetensors file"),
    "too long": (encode(one(), bytes(9)), "not fully covered"),
    "dtype size": (encode(one("F64"), bytes(8)), "not a whole safetensors file"),
    "unknown dtype": (encode(one("BF16", (4,)), bytes(8)), "tensor 'a' of type BF16"),
    "absurd size": (encode(one(shape=(2**62, 2**62))), "overflow"),
    "absurd and empty": (encode(one(shape=(0, 2**62), offsets=(0, 0))), r"shape \[0, 4611686018427387904\]"),
    "dimensions": (encode(one(shape=[1] * 100, offsets=(0, 4)), bytes(4)), "tensor 'a' has shape"),
    "overlap": (encode(one() | {"b": one()["a"]}, bytes(8)), "invalid offset for tensor"),
    "metadata": (encode(one(metadata="{"), bytes(8)), "is not JSON"),
    "metadata list": (encode(one(metadata="[]"), bytes(8)), "not a JSON object"),
    "metadata bomb": (encode(one(metadata="[" * 100_000), bytes(8)), "is not JSON"),
    "metadata number": (encode(one(metadata="9" * 10_000), bytes(8)), "is not JSON"),
}


@pytest.mark.parametrize("case", DAMAGED)
def test_damaged_files_are_refused_with_the_field_named(tmp_path, case):
    data, message = DAMAGED[case]
    path = tmp_path / "a.safetensors"
    path.write_bytes(data)
    with pytest.raises(InputError, match=message) as error:
        load_tensors(path)
    assert str(error.value).startswith(f"{path}: ") and "\n" not in str(error.value) and len(str(error.value)) < 600


def test_missing_files_and_folders_are_refused(tmp_path):
    for path in (tmp_path / "none.safetensors", tmp_path):
        with pytest.raises(InputError, match="no such file"):
            load_tensors(path)


@quiet
@given(st.data())
def test_no_damage_does_more_than_an_input_error(tmp_path, data):
    path = tmp_path / "a.safetensors"
    save_tensors(path, {"a": np.arange(6.0).reshape(2, 3), "b": np.ones(4, np.float16)}, {"sizes": [1, 2]})
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content[: data.draw(st.just(len(content)) | st.integers(0, len(content)))])
    try:
        tensors, metadata = load_tensors(path)
    except InputError:
        return
    assert isinstance(metadata, dict) and sum(array.nbytes for array in tensors.values()) <= len(content)

"""Networks, checkpoints and RTXNS's files, damaged at random: each is one of these still, or an `InputError` of a line.

`WARP_NEURAL_DAMAGED=9000 pytest tests/test_damaged_files.py` tries more.
"""

import json
import os
import struct
from pathlib import Path

import numpy as np
import pytest
import warp as wp

import warp_neural as wn
from warp_neural.cli.commands import Info

FILES = int(os.environ.get("WARP_NEURAL_DAMAGED", "480"))
SIZES = (0, 1, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**63, 2**64 - 1)
VALUES = (0, -1, 2**31, 2**64, 1e308, float("nan"), "", None, [], {}, "relu", "\ud800", "a" * 5000, True, [[[]]])


@wp.func
def sample(index: int, random: wn.random.Stream):
    return wp.vec2(wn.random.uniform(random, 0)[0]), wp.vec3()


@pytest.fixture(scope="module")
def trainer():
    net = wn.MLP(2, 3, 8, 1, precision="float32", device="cpu")
    return wn.Trainer(net, sample=sample, batch=16, average=0.9)


@pytest.fixture(scope="module")
def sources(trainer, tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    latent = wn.encodings.LatentTexture(3, 2, channels=2)
    wn.save_network(folder / "latent.safetensors", wn.MLP(2, 3, 8, 1, encoding=latent, device="cpu"))
    wn.save_network(folder / "int8.safetensors", wn.MLP(2, 3, 8, 1, precision="int8", count=2, device="cpu"))
    wn.save_rtxns(folder / "net.ns.bin", trainer.net)
    wn.save_rtxns(folder / "net.json", trainer.net)
    trainer.run(2, quiet=True)
    trainer.save(folder / "checkpoint.safetensors")
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def changed(value, rng):
    """JSON with another value, key or length at one place; texts that hold JSON are looked into."""
    if isinstance(value, dict | list) and value and rng.random() < 0.85:
        key = list(value)[rng.integers(len(value))] if isinstance(value, dict) else rng.integers(len(value))
        if rng.random() < 0.2:
            del value[key]
        else:
            value[key] = changed(value[key], rng)
        return value
    if isinstance(value, str) and value.startswith("{"):
        return json.dumps(changed(json.loads(value), rng))
    return VALUES[rng.integers(len(VALUES))]


def with_header_changed(name, data, rng):
    if name.endswith(".json"):
        return json.dumps(changed(json.loads(data), rng)).encode()
    if name.endswith(".bin"):
        return data + rng.bytes(rng.integers(1, 200))
    end = 8 + struct.unpack("<Q", data[:8])[0]
    text = json.dumps(changed(json.loads(data[8:end]), rng)).encode()
    return struct.pack("<Q", len(text)) + text + data[end:]


def damaged(name, sources, rng):
    data = sources[name]
    at, length = rng.integers(len(data)), rng.integers(1, 65)
    other = sources[list(sources)[rng.integers(len(sources))]]
    bits = bytearray(data)
    for _ in range(rng.integers(1, 9)):
        bits[rng.integers(len(bits))] ^= 1 << rng.integers(8)
    size = struct.pack("<Q", SIZES[rng.integers(len(SIZES))])[: 4 * rng.integers(1, 3)]
    start = rng.integers(min(len(data) - 8, 128))
    ways = (
        data[:at],
        bytes(bits),
        data[:at] + other[rng.integers(len(other)) :],
        data[:at] + rng.bytes(length) + data[at:],
        data[:at] + data[at + length :],
        data[:start] + size + data[start + len(size) :],
        with_header_changed(name, data, rng),
    )
    return ways[rng.integers(len(ways))]


@pytest.mark.parametrize("part", range(4))
def test_damaged_files_are_whole_or_refused(tmp_path, sources, trainer, part):
    rng, refused = np.random.default_rng(part), 0
    for number in range(FILES // 4):
        name = list(sources)[number % len(sources)]
        path = tmp_path / ("file" + "".join(Path(name).suffixes))
        path.write_bytes(damaged(name, sources, rng))
        read = [Info(file=path, json=True).main]
        if name.startswith("checkpoint"):
            read.append(lambda path=path: trainer.load(path))
        for call in read:
            try:
                json.dumps(call())
            except wn.InputError as error:
                refused += 1
                assert str(error).startswith(f"{path}: ") and "\n" not in str(error)
    assert refused > FILES // 8

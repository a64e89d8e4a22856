"""Files of neural textures: all returns bit for bit, a part is the part of the whole, bytes are few."""

import errno
import os
from pathlib import Path

import numpy as np
import pytest
from wntc_states import E24, SMALL, assert_same, golden_spec, make_state

from warp_neural.errors import InputError
from warp_neural.kernels.texture.spec import Grid, TextureSpec
from warp_neural.texture.file import TextureFile, coded_bits, load_state, save_state, to_bytes

ONE = (Grid(4, 8, "learned"),)
FINE = (Grid(1, 2, "learned", 3), Grid(2, 2, "bilinear", 2), Grid(32, 32, "bilinear", 8))
EVERY = tuple(Grid(2**i, i + 1, "bilinear", bits) for i, bits in enumerate((8, 4, 2, 1, 5, 7)))
SPECS = {
    "one texel": TextureSpec(1, 1, 1, 1, SMALL, (8,)),
    "odd": TextureSpec(17, 5, 3, 5, SMALL, (8, 8)),
    "tall": TextureSpec(1000, 3, 16, 2, ONE, (16,)),
    "wide": TextureSpec(4, 16384, 2, 1, SMALL, (8,)),
    "several blocks": TextureSpec(300, 520, 4, 2, E24, (64, 64)),
    "fine": TextureSpec(70, 290, 16, 7, FINE, (256,)),
    "widths": TextureSpec(64, 64, 7, 7, EVERY, (1, 5)),
}


@pytest.mark.parametrize("name", SPECS)
def test_states_return(name, tmp_path, device):
    state = make_state(SPECS[name], extra={"psnr": [31.25, {"é": None}]})
    sizes = save_state(tmp_path / "a.wntc", state)
    assert_same(state, load_state(tmp_path / "a.wntc", device))
    parts = [sizes[part] for part in ("header", "network", "contexts", "index")]
    size = (tmp_path / "a.wntc").stat().st_size
    assert sum(parts) + sum(map(sum, sizes["latents"])) == sizes["all"] == size
    assert (tmp_path / "a.wntc").read_bytes() == to_bytes(state)


def test_latents_of_zeros_cost_a_byte_a_block(tmp_path):
    state = make_state(TextureSpec(512, 512, 3, 1, SMALL, (8,)), zeros=0)
    sizes = save_state(tmp_path / "a.wntc", state)
    assert sum(sizes["latents"][0]) == 0 and sizes["index"] == 3 * 4 + 5
    assert_same(state, load_state(tmp_path / "a.wntc"))


@pytest.mark.parametrize("rectangle", [(0, 0, 1, 1), (255, 250, 2, 50), (519, 299, 1, 1), (0, 128, 520, 100)])
def test_a_rectangle_is_the_part_of_the_whole(tmp_path, rectangle):
    spec = SPECS["several blocks"]
    state = make_state(spec)
    save_state(tmp_path / "a.wntc", state)
    left, top, width, height = rectangle
    parts = TextureFile(tmp_path / "a.wntc").latents(0, rectangle)
    for g, (grid, part) in enumerate(zip(spec.grids, parts, strict=True)):
        rows, columns = spec.cells(0, g)
        i = np.arange(top // grid.scale, (top + height - 1) // grid.scale + 2) % rows
        j = np.arange(left // grid.scale, (left + width - 1) // grid.scale + 2) % columns
        assert (part == state.latents[0][g][i[:, None], j]).all()


def test_a_mip_alone_is_as_with_the_others(tmp_path, device):
    state = make_state(SPECS["odd"])
    save_state(tmp_path / "a.wntc", state)
    file = TextureFile(tmp_path / "a.wntc")
    for mip, grids in enumerate(state.latents):
        assert all((ours == theirs).all() for ours, theirs in zip(grids, file.latents(mip, device=device), strict=True))


def test_a_part_is_read_without_the_rest(tmp_path):
    path, spec = tmp_path / "a.wntc", SPECS["several blocks"]
    state = make_state(spec)
    save_state(path, state)
    index = TextureFile(path).streams
    data = bytearray(path.read_bytes())
    first = int(index[1, 2].starts[0])
    data[int(index[0, 0].starts[-1]) : first] = bytes(first - int(index[0, 0].starts[-1]))  # mip 0, grid 0: last block
    path.write_bytes(data)
    file = TextureFile(path)
    assert all((a == b).all() for a, b in zip(file.latents(1), state.latents[1], strict=True))
    file.latents(0, (0, 0, 200, 200))
    with pytest.raises(InputError, match=r"a\.wntc: mip 0 grid 0 block 5: "):
        file.latents(0)


@pytest.mark.parametrize("rectangle", [(0, 0, 1, 0), (0, -1, 1, 1), (0, 0, 1, 49), (60, 0, 5, 1)])
def test_rectangles_outside_are_refused(tmp_path, rectangle):
    save_state(tmp_path / "a.wntc", make_state(golden_spec()))
    with pytest.raises(InputError, match="mip 0 is 64 x 48; choose left, top, width, height inside"):
        TextureFile(tmp_path / "a.wntc").latents(0, rectangle)


def test_a_full_disk_leaves_the_old_file(tmp_path, monkeypatch):
    path, state = tmp_path / "a.wntc", make_state(golden_spec())
    save_state(path, state)

    def write(self, data):
        with open(self, "wb") as file:
            file.write(data[: len(data) // 2])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", write)
    with pytest.raises(InputError, match=r"a\.wntc: could not be written \(No space left on device\)"):
        save_state(path, make_state(golden_spec(), seed=1))
    assert_same(state, load_state(path))


def test_what_a_file_cannot_hold_is_refused(tmp_path):
    state = make_state(golden_spec(), extra={"error": float("nan")})
    with pytest.raises(InputError, match="extra: cannot be written as JSON"):
        to_bytes(state)


def test_searches_know_the_size():
    state = make_state(SPECS["several blocks"])
    assert coded_bits(state) == 8 * len(to_bytes(state))

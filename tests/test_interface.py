"""What users meet first: names, versions, and one line for every argument that makes no sense."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
import warp as wp

import warp_neural as wn
from warp_neural import InputError, coopvec, encodings, losses, optim

ROOT = Path(__file__).resolve().parent.parent
ROW = np.zeros((3, 5), np.float32)


@wp.func
def sample(index: int, random: wn.random.Stream):
    return wp.vec2(), wp.vec3()


def net(**options):
    return wn.MLP(**{"n_in": 2, "n_out": 3, "width": 16, "depth": 1, "device": "cpu"} | options)


REFUSED = [
    (lambda: net(precision=wp.float16), "precision=.*: expected one of float32, tf32, float16"),
    (lambda: net(n_in=5, encoding=encodings.HashGrid()), "HashGrid: n_in=5: expected a whole number of 1 to 4"),
    (lambda: net(encoding=encodings.OneBlob(200)), r"a network has 1 to 9 layers of sizes 1 to 256"),
    (lambda: net(encoding=encodings.Frequency(2), dtype=wp.float16), "encodings give float32; leave dtype out"),
    (lambda: net().to("cuda:77"), "device='cuda:77': not on this machine"),
    (lambda: wn.MLP.from_state(net().state, device="gpu"), "device='gpu': not on this machine"),
    (lambda: net().evaluate(np.zeros((4, 3))), r"expected \[n, 2\] of float32"),
    (lambda: wn.Trainer("net", sample=sample), "net='net': expected a wn.MLP"),
    (lambda: wn.Trainer(net(), sample=lambda i, r: None), "sample=.*: expected a @wp.func"),
    (lambda: wn.Trainer(net(), sample=sample, batch="all"), "batch='all': expected at least one sample"),
    (lambda: wn.Trainer(net(), sample=sample, batches=1.5), "batches=1.5: expected a whole number"),
    (lambda: wn.Trainer(net(), sample=sample, average="slow"), "average='slow': expected the decay"),
    (lambda: wn.Density("picture"), "image: no array of numbers"),
    (lambda: wn.Density(np.ones((2, 2)), device="gpu"), "device='gpu'"),
    (lambda: losses.huber(None), "huber: delta=None: expected a positive number"),
    (lambda: optim.Adam(lr=None), "lr=None: expected a rate"),
    (lambda: coopvec.MatrixSpec(3, 300), "columns=300: expected a whole number of 1 to 256"),
    (lambda: coopvec.MatrixSpec(3, 5, "half"), "precision='half': expected one of"),
    (lambda: coopvec.MatrixSpec(3, 5, layout="optimal"), "layout='optimal': expected one of row_major"),
    (lambda: coopvec.MatrixSpec(3, 5, dtype=float), "dtype=.*: expected wp.float32 or wp.float16"),
    (lambda: coopvec.MatrixSpec(3, 5, "int8", accumulation="float16"), "int8 accumulates in float32 only"),
    (lambda: coopvec.MatrixSpec(3, 5, bias="float16"), "bias='float16': expected float32"),
    (lambda: coopvec.make_load(0, wp.float32), "n=0: expected a whole number of 1 to 256"),
    (lambda: coopvec.make_store(8, int), "dtype=.*: expected wp.float32"),
    (lambda: coopvec.make_reduce_sum_accumulate(300, wp.float32), "n=300"),
    (lambda: coopvec.make_outer_product_accumulate(coopvec.MatrixSpec(3, 5, "int8")), "floating-point precision"),
    (lambda: coopvec.matrix_size(3, 5, "half", "row_major"), "matrix precision='half': expected one of"),
    (lambda: coopvec.pack_matrix("matrix", "float16", "row_major"), "values: no array of numbers"),
    (lambda: coopvec.pack_matrix(ROW, "float16", "row_major", device="gpu"), "device='gpu'"),
    (lambda: coopvec.unpack_matrix([0], 3, 5, "float16", "row_major"), "source buffer='list': expected a Warp or"),
    (lambda: coopvec.supported_combinations("gpu"), "device='gpu'"),
]


@pytest.mark.parametrize(("make", "message"), REFUSED, ids=range(len(REFUSED)))
def test_bad_arguments_are_one_line(make, message):
    with pytest.raises(InputError, match=message) as error:
        make()
    assert "\n" not in str(error.value) and len(str(error.value)) < 300


def test_parameters_of_networks_and_encodings_are_counted():
    grid = encodings.HashGrid(levels=2, log2_size=4)
    both, alone = net(encoding=grid, count=3), net(encoding=grid)
    assert both.n_parameters == alone.n_parameters == 16 * (4 + 1) + 3 * (16 + 1) + grid.n_parameters(2)
    assert net(depth=0).width == 0 and net(depth=0).depth == 0


def test_the_version_is_the_projects():
    assert wn.__version__ == tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]


def test_all_names_are_there():
    assert all(hasattr(wn, name) for name in wn.__all__)
    assert wn.initialization.he_normal(np.random.default_rng(0), 3, 2).shape == (3, 2)

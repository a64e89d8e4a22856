"""Counts that do not fit into the 32 bits of device code are refused by the limit's name, before memory is taken."""

import numpy as np
import pytest
import warp as wp
from test_trainer import line

import warp_neural as wn
from warp_neural import encodings


def small(**options):
    return wn.MLP(2, 3, 16, 1, device="cpu", **options)


@pytest.mark.parametrize(
    "options",
    [{"batch": 2**31}, {"batch": 10**12}, {"batch": 10**30}, {"batch": 2**20, "batches": 2**11},
     {"batch": [64, 2**31]}, {"batch": 2**30 + 1}, {"batch": np.uint64(2**63)}],
    ids=str,
)  # fmt: skip
@pytest.mark.parametrize("fused", [None, False])
def test_samples_of_a_step(options, fused):
    samples = int(np.max(np.array(options["batch"], object))) * options.get("batches", 1)
    message = f"batch . batches={samples}: expected at most MAX_SAMPLES=1073741824 samples a step"
    with pytest.raises(wn.InputError, match=message):
        wn.Trainer(small(), sample=line, fused=fused, **options)


def test_steps_of_a_run():
    run = wn.Trainer(small(), sample=line, batch=32)
    run.run(3, quiet=True)
    for steps in (2**31 - 3, 2**31, 10**30):
        with pytest.raises(wn.InputError, match=f"steps={steps}: expected a whole number of 0 to 2147483644"):
            run.run(steps)
    assert run.index == 3


@pytest.mark.parametrize("rows", [2**31 - 1, 2**31, 10**12])
def test_rows(rows):
    with pytest.raises(wn.InputError, match=f"rows={rows}: expected a whole number of 0 to 2147483583"):
        small().evaluate(np.broadcast_to(np.float32(0), (rows, 2)))


def test_networks_and_parameters():
    with pytest.raises(wn.InputError, match="count=100000000: expected a whole number of 1 to"):
        small(count=10**8)
    with pytest.raises(wn.InputError, match=r"parameters of HashGrid=.*: expected a whole number of 0 to"):
        small(encoding=encodings.HashGrid(levels=16, log2_size=28, base_resolution=4096))


def test_what_fits_is_taken():
    assert small().evaluate(np.zeros((0, 2))).shape == (0, 3)
    assert small().evaluate(wp.zeros((5, 2), dtype=float, device="cpu")).shape == (5, 3)

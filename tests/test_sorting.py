"""Threads sorted by network."""

import numpy as np
import pytest
import warp as wp

from warp_neural import InputError, sort_by_network


@pytest.mark.parametrize("n", [0, 1, 1000])
def test_order_is_ascending_and_stable(device, n):
    network = np.random.default_rng(n).integers(0, 40, n).astype(np.int32)
    order = sort_by_network(wp.array(network, dtype=int, device=device))
    np.testing.assert_array_equal(order.numpy(), np.argsort(network, kind="stable"))


def test_strided_array(device):
    table = np.random.default_rng(0).integers(0, 9, (50, 2)).astype(np.int32)
    order = sort_by_network(wp.array(table, dtype=int, device=device)[:, 1])
    np.testing.assert_array_equal(order.numpy(), np.argsort(table[:, 1], kind="stable"))


@pytest.mark.parametrize("network", [np.zeros(3, np.int32), wp.zeros(3, dtype=float, device="cpu")])
def test_other_types_are_refused(network):
    with pytest.raises(InputError, match="expected a one-dimensional Warp array of int32"):
        sort_by_network(network)

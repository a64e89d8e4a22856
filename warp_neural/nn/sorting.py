"""Threads in the order of their networks, so that the lanes of a warp share one."""

import warp as wp

from warp_neural.errors import InputError


@wp.kernel(enable_backward=False)
def start_kernel(network: wp.array[int], keys: wp.array[int], order: wp.array[int]):
    i = wp.tid()
    keys[i] = network[i]
    order[i] = i


def sort_by_network(network: wp.array) -> wp.array:
    """The order in which threads have ascending networks: int32 [n]; equal ones keep their order.

    network: int32 [n] on any device, what `net.select` is given in each thread. Thread t of the kernel then takes the
    place of thread `order[t]`: reads and writes its data, and selects its network. Warps whose lanes share a network
    multiply it once; of k networks in a warp, one after the other. Two launches' time and 16 bytes a thread, on the
    stream of the device; for kernels that do much more. Raises `InputError` for another type or shape.
    """
    if not isinstance(network, wp.array) or network.dtype is not wp.int32 or network.ndim != 1:
        raise InputError("sort_by_network: expected a one-dimensional Warp array of int32, a network of each thread")
    n, device = network.size, network.device
    keys, order = (wp.empty(2 * n, dtype=int, device=device) for _ in range(2))  # the sort works in the second half
    wp.launch(start_kernel, n, [network, keys, order], device=device, record_tape=False)
    wp.utils.radix_sort_pairs(keys, order, n)
    return order[:n] if n else order

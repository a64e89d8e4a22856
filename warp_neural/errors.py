"""The one exception for input that a user can mend, and devices by name."""

import warp as wp

from warp_neural.kernels.errors import InputError

__all__ = ["InputError", "find_device"]


def find_device(device: wp.DeviceLike) -> wp.Device:
    """The device of a name, such as "cuda:0"; None is the current one."""
    try:
        return wp.get_device(device)
    except (RuntimeError, TypeError, ValueError):
        there = ", ".join(each.alias for each in wp.get_devices())
        raise InputError(f"device={device!r}: not on this machine, which has {there}; take one of these") from None

"""Loading of kernels that are compiled for exactly one architecture."""

from threading import Lock
from typing import Protocol

import warp as wp

ARCH = Lock()  # of Warp's setting of the process, which no module has for itself: one thread at a time changes it


class Needs(Protocol):
    """What a schedule says of its kernels: the suffix of the architecture, empty for any; threads of a block."""

    arch_suffix: str
    threads: int


def load_for(kernel: wp.Kernel, schedule: Needs, device: wp.Device) -> None:
    """Compile and load a kernel for the architecture that its schedule needs."""
    with ARCH:
        before = wp.config.cuda_arch_suffix
        wp.config.cuda_arch_suffix = schedule.arch_suffix or before
        try:
            wp.load_module(kernel.module, device, block_dim=schedule.threads)
        finally:
            wp.config.cuda_arch_suffix = before

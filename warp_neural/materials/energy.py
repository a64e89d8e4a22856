"""The tables of directional albedo, made once a device."""

from functools import cache

import warp as wp

from warp_neural.kernels.materials.energy import EnergyTables, long_kernel, round_kernel

_ROUND, _ROUND_SIDE = (32, 32), 64  # nodes, and the root of the number of facets in each one's integral
_LONG, _LONG_SIDE = (32, 18, 18, 4), 20


@cache
def energy_tables(device: str, anisotropic: bool) -> EnergyTables:
    """On the device of that alias: 8 KiB, and 324 KiB more for anisotropic facets; deterministic."""
    tables = EnergyTables()
    tables.round_energy, tables.round_share = _make(device, round_kernel, _ROUND, _ROUND_SIDE)
    if anisotropic:
        tables.long_energy, tables.long_share = _make(device, long_kernel, _LONG, _LONG_SIDE)
    else:
        tables.long_energy, tables.long_share = (wp.zeros((1, 1, 1, 1), dtype=float, device=device) for _ in range(2))
    return tables


def _make(device: str, kernel: wp.Kernel, shape: tuple[int, ...], side: int) -> list[wp.array]:
    tables = [wp.empty(shape, dtype=float, device=device) for _ in range(2)]
    wp.launch(kernel, dim=shape, inputs=[side], outputs=tables, device=device)
    return tables

"""What a CUDA kernel needs, asked of the driver, and what the GPU's counters say of it, by Nsight Compute (`ncu`)."""

import csv
import ctypes
import io
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import warp as wp

from perf.sass import find_tool

ATTRIBUTES = {"shared": 1, "stack": 3, "registers": 4}  # CUfunction_attribute: bytes of a block, bytes, number a thread
# by what a table calls them: the counter in base units, its unit there, and what makes that of it
COUNTERS = {
    "time": ("gpu__time_duration.sum", "us", 1e-3),
    "tensor pipe": ("sm__inst_executed_pipe_tensor.avg.pct_of_peak_sustained_active", "%", 1.0),
    "issue slots": ("sm__inst_issued.avg.pct_of_peak_sustained_active", "%", 1.0),
    "L1 and shared": ("l1tex__data_pipe_lsu_wavefronts.avg.pct_of_peak_sustained_elapsed", "%", 1.0),
    "L2": ("lts__t_sectors.avg.pct_of_peak_sustained_elapsed", "%", 1.0),
    "DRAM": ("dram__throughput.avg.pct_of_peak_sustained_elapsed", "%", 1.0),
    "DRAM rate": ("dram__bytes.sum.per_second", "GB/s", 1e-9),
    "active warps": ("sm__warps_active.avg.per_cycle_active", "", 1.0),
}
SECONDS = 150  # after which ncu is given up


def driver() -> ctypes.CDLL:
    return ctypes.CDLL("nvcuda.dll" if os.name == "nt" else "libcuda.so.1")


def call(name: str, *arguments) -> None:
    error = getattr(driver(), name)(*arguments)
    if error:
        raise RuntimeError(f"{name}: CUDA error {error}")


def resources(command: wp.Launch) -> dict[str, int]:
    """Of a recorded launch: `ATTRIBUTES`, shared memory with the dynamic part, and the warps that fit at once.

    Bytes of `stack` are arrays that the program indexes, calls, and registers that spilled.
    """
    hooks = command.hooks
    function, dynamic = hooks.forward, hooks.forward_smem_bytes
    if command.adjoint:
        function, dynamic = hooks.backward, hooks.backward_smem_bytes
    function = ctypes.c_void_p(function)
    call("cuCtxSetCurrent", ctypes.c_void_p(command.device.context))
    found, value = {}, ctypes.c_int()
    for name, attribute in ATTRIBUTES.items():
        call("cuFuncGetAttribute", ctypes.byref(value), attribute, function)
        found[name] = value.value
    arguments = [ctypes.byref(value), function, command.block_dim, ctypes.c_size_t(dynamic)]
    call("cuOccupancyMaxActiveBlocksPerMultiprocessor", *arguments)
    found["shared"] += dynamic
    return found | {"warps": value.value * -(-command.block_dim // 32)}


@contextmanager
def marked() -> Iterator[None]:
    """What `ncu --profile-from-start off` looks at."""
    call("cuProfilerStart")
    yield
    call("cuProfilerStop")


def count(arguments: list[str], kernels: int) -> list[dict[str, float]]:
    """`COUNTERS` of each of the `kernels` that `python ARGUMENTS` launches while `marked`.

    Raises `RuntimeError` where that cannot be had: it takes ncu, and mostly the rights of an administrator.
    """
    tool = find_tool("ncu")
    if tool is None:
        raise RuntimeError("no counters: ncu is neither on PATH nor in /usr/local/cuda*/bin")
    metrics = ",".join(name for name, _unit, _factor in COUNTERS.values())
    options = "--csv --page raw --print-units base --clock-control none --profile-from-start off --metrics".split()
    command = [tool, *options, metrics, sys.executable, *arguments]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS)
    except subprocess.TimeoutExpired as error:
        raise RuntimeError(f"no counters: ncu took more than {SECONDS} s") from error
    rows = parse(done.stdout)
    if len(rows) != kernels:
        said = [line for line in (done.stdout + done.stderr).splitlines() if "==ERROR==" in line]
        why = said[0].removeprefix("==ERROR== ") if said else f"{len(rows)} kernels of {kernels}"
        raise RuntimeError(f"no counters: ncu says: {why}")
    return rows


def parse(text: str) -> list[dict[str, float]]:
    """The rows of what `ncu --csv --page raw` prints, after other lines and with units in its second line."""
    _, header, table = text.partition('"ID",')
    if not header:
        return []
    rows = list(csv.DictReader(io.StringIO(header + table)))[1:]
    return [
        {
            name: float(row[counter].replace(",", "")) * factor
            for name, (counter, _unit, factor) in COUNTERS.items()
            if row.get(counter, "").replace(",", "").replace(".", "").isdigit()
        }
        for row in rows
    ]

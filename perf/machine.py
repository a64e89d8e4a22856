"""What a measurement ran on: processor, driver, versions, clocks."""

import platform
import re
import subprocess
from pathlib import Path

import warp as wp

QUERY = {
    "driver": "driver_version", "SM clock": "clocks.sm", "largest SM clock": "clocks.max.sm",
    "memory clock": "clocks.mem", "power": "power.draw", "power limit": "power.limit", "temperature": "temperature.gpu",
}  # fmt: skip


def cpu_name() -> str:
    """As Linux names it, else as Python does."""
    info = Path("/proc/cpuinfo")
    found = re.search(r"model name\s*:\s*(.+)", info.read_text()) if info.exists() else None
    return found[1].strip() if found else platform.processor() or platform.machine()


def name_of(device: wp.Device) -> str:
    return device.name if device.is_cuda else cpu_name()


def slug(name: str) -> str:
    """A name for a folder, such as nvidia-h200."""
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")


def facts(device: wp.Device) -> dict[str, str]:
    """Of `device`; its clocks and power right after the last kernels, where nvidia-smi is there."""
    result = {"device": name_of(device)}
    if device.is_cuda:
        result |= {"architecture": f"sm_{device.arch}", "multiprocessors": str(device.sm_count)} | gpu_state(device)
    result |= {"CPU": cpu_name(), "Warp": wp.__version__, "Python": platform.python_version()}
    return result


def gpu_state(device: wp.Device) -> dict[str, str]:
    command = ["nvidia-smi", f"--id={device.uuid}", f"--query-gpu={','.join(QUERY.values())}", "--format=csv,noheader"]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, timeout=10, check=True).stdout
    except (OSError, subprocess.SubprocessError):
        return {}
    values = [value.strip() for value in answer.strip().split(",")]
    return dict(zip(QUERY, values, strict=True)) if len(values) == len(QUERY) else {}

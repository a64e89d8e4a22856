"""Whole commands of the samples, each in a new process with an empty kernel cache: `python -m perf.samples`.

Their seconds, peak memory and the figures that the goals name. Not part of `--quick`.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from importlib.util import find_spec

from perf.measure import Bench, Config
from perf.pictures import bars
from warp_neural.cli import progress, run


def run_sample(name: str, device: str) -> tuple[dict, float]:
    """Its metrics and the seconds of the whole command."""
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", f"samples.{name}", "--json", "--device", device, "--out", f"{folder}/out"]
        environment = os.environ | {"WARP_CACHE_PATH": f"{folder}/cache"}
        done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"samples.{name} failed:\n{done.stderr}")
    return json.loads(done.stdout.splitlines()[-1]), time.perf_counter() - begin


def mipmap_ratios(metrics: dict) -> dict[str, float]:
    """Errors of the learned maps against the other ways; see `samples.mipmap`."""
    return {
        "linear error / box": metrics["linear_adam"] / metrics["linear_box"],
        "linear error / Toksvig": metrics["linear_adam"] / metrics["linear_toksvig"],
        "linear error / SGD": metrics["linear_adam"] / metrics["linear_sgd"],
        "displayed error / better": metrics["display_adam"] / min(metrics["display_box"], metrics["display_toksvig"]),
    }


def network_figures(metrics: dict) -> dict[str, float]:
    return {key: value for key, value in metrics.items() if key.startswith("psnr_step")}


SAMPLES = {"mipmap": mipmap_ratios, "network": network_figures}


def main(config: Config) -> dict:
    bench = Bench("samples", config)
    bench.result.settings["rounds"] = "one run each"
    for name in progress([name for name in SAMPLES if find_spec(f"samples.{name}.__main__")], config):
        metrics, seconds = run_sample(name, bench.device.alias)
        bench.add(name, "command", seconds, "s")
        bench.add(name, "largest memory so far", resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 2**20, "GB")
        for label, value in SAMPLES[name](metrics).items():
            bench.add(f"{name}: {label.replace('_', ' ')}", "figure", value, "")
    return bench.finish(lambda result: bars(result, "Whole commands", "s"))


if __name__ == "__main__":
    run(main, Config)

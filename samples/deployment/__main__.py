"""A picture's network, trained here, exported to C++, shaders and a page, built and run: the same picture from each.

    python -m samples.deployment [--targets cpp,wgsl] [--image FILE]

Leaves a folder for each target, which builds without Python, and deployment.png: Python's picture, each target's, what
ran it, how long 65,536 pixels took and the largest difference from Python. What this machine cannot build or run is
exported all the same, and the table says what is missing: g++; an NVIDIA driver; wgpu with a driver (pip install wgpu);
glslangValidator; slangc, which pip's slangtorch carries; Vulkan's headers; chromium and playwright (pip install
playwright). vulkan alone is not exported without one of these compilers. Times are of a second run, with copies, but
cuda's and vulkan's of the device's work; a software driver takes its time.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from warp_neural import cli
from warp_neural.errors import InputError
from warp_neural.export import TARGETS, export, spirv
from warp_neural.export.shaders import SHADERS
from warp_neural.imaging.image import srgb_to_linear
from warp_neural.nn.mlp import MLP
from warp_neural.samples.deployment import browser, programs, vulkan, webgpu
from warp_neural.samples.deployment.programs import NAME, Run
from warp_neural.samples.figures import save_figure, show
from warp_neural.samples.network import step_04_frequency_encoding
from warp_neural.samples.network.step_01_basic_network import train
from warp_neural.samples.network.target import Config as NetworkConfig
from warp_neural.samples.network.target import load_target, psnr, srgb_codes


@dataclass(frozen=True, kw_only=True)
class Config(NetworkConfig):
    out: Path = Path("out/deployment")
    """folder for the exported folders and the picture"""
    targets: str = ",".join(TARGETS)
    """which to export"""


def run_shader(language: str, folder: Path, inputs: np.ndarray, expected: np.ndarray) -> Run:
    if lacking := webgpu.missing(language):
        return Run(f"not run: no {lacking}")
    source = folder / f"{NAME}.{SHADERS[language].suffix}"
    build = folder / "build"
    build.mkdir(exist_ok=True)
    weights = np.fromfile(folder / "weights.bin", np.float32)
    code = webgpu.compiled(language, source, build)
    results, seconds = webgpu.evaluate(code, weights, inputs, expected.shape[1])
    return Run(f"wgpu, {webgpu.device().adapter.info['device']}", results, expected, seconds)


def run_page(folder: Path, net: MLP) -> Run:
    """Of the page's own pixels, which have 8 bits."""
    if lacking := browser.missing():
        return Run(f"not run: no {lacking}")
    with browser.browser() as started:
        page = browser.opened(started, folder / f"{NAME}.html")
        codes, uv = browser.pixels(page)
        _first, milliseconds = browser.milliseconds(page)
    expected = net.evaluate(uv.reshape(-1, 2).astype(np.float32)).numpy().reshape(codes.shape)
    return Run("Chromium, WebGL2", srgb_to_linear(codes / 255), np.clip(expected, 0, 1), milliseconds / 1e3)


def run_target(target: str, folder: Path, net: MLP, inputs: np.ndarray, expected: np.ndarray) -> Run:
    """net: on the CPU."""
    if target == "html":
        return run_page(folder, net)
    if target in programs.RUN:
        return programs.RUN[target](folder, inputs, expected)
    if target == "vulkan":
        how, results, seconds = vulkan.evaluate(folder, inputs, expected)
        return Run(how, results, expected, seconds)
    if target in webgpu.LANGUAGES:
        return run_shader(target, folder, inputs, expected)
    return Run("not run: no compiler here")


def runs(net: MLP, config: Config, targets: list[str], size: tuple[int, int]) -> Iterator[tuple[str, int, Run]]:
    """Of each target: bytes of the folder, the run."""
    height, width = size
    v, u = np.meshgrid((np.arange(height) + 0.5) / height, (np.arange(width) + 0.5) / width, indexing="ij")
    inputs = np.stack([u, v], axis=-1).reshape(-1, 2).astype(np.float32)
    on_cpu = net.to("cpu")
    expected = on_cpu.evaluate(inputs).numpy()
    yield "python", 0, Run("Warp, cpu", expected, expected)
    for target in targets:
        folder = config.out / target
        if target == "vulkan" and (lacking := spirv.missing(net.state.spec.format.name)):
            yield target, 0, Run(f"not run: no {lacking}")
            continue
        made = export(net, target, folder, archs=programs.archs() if target == "cuda" else None, name=NAME, force=True)
        yield target, sum(made["files"].values()), run_target(target, folder, on_cpu, inputs, expected)


def main(config: Config) -> dict:
    targets = [name.strip() for name in config.targets.split(",")]
    for name in targets:
        if name not in TARGETS:
            raise InputError(f"--targets {name}: give some of {', '.join(TARGETS)}")
    picture = load_target(config)
    net, seconds = train(config, "deployment", step_04_frequency_encoding.make_network, picture)
    metrics, shown = {"seconds_of_training": seconds}, {}
    for target, size, run in runs(net, config, targets, picture.shape[:2]):
        metrics |= {f"how_{target}": run.how, f"bytes_{target}": size}
        if run.results is not None:
            shown[target] = run.results.reshape(picture.shape if run.results.ndim == 2 else run.results.shape)
            metrics |= {f"difference_{target}": run.difference, f"milliseconds_{target}": 1e3 * run.seconds}
    metrics["psnr_python"] = psnr(shown["python"], picture)
    save_sheet(config.out / "deployment.png", shown, metrics)
    return metrics


def save_sheet(path: Path, shown: dict[str, np.ndarray], metrics: dict) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.2 * len(shown), 3.9), layout="constrained")
    for axis, (target, linear) in zip(figure.subplots(1, len(shown), squeeze=False)[0], shown.items(), strict=True):
        about = f"{metrics[f'bytes_{target}'] / 1e3:.0f} kB, {metrics[f'milliseconds_{target}']:.0f} ms, "
        about += f"off by {metrics[f'difference_{target}']:.1g}"
        title = f"{target}\n{metrics[f'how_{target}']}\n{about if target != 'python' else ''}"
        show(axis, srgb_codes(linear) / 255, title)
    save_figure(path, figure)


if __name__ == "__main__":
    cli.run(main, Config)

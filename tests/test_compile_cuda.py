"""Every CUDA kernel compiles ahead of time for Hopper; this needs no GPU."""

import importlib

import pytest
import warp as wp

MODULES = [
    "kernels.optimizers",
    "kernels.texture",
    "samples.mipmap.judge",
    "samples.mipmap.learn",
    "samples.mipmap.step_01_basic_program",
    "samples.mipmap.step_04_loss",
    "samples.mipmap.step_05_train",
]


@pytest.mark.parametrize("name", MODULES)
def test_compiles_for_hopper(name, tmp_path):
    importlib.import_module(name)
    (artifact,) = wp.compile_aot_module(name, arch=90, module_dir=tmp_path)
    assert artifact.stat().st_size > 0

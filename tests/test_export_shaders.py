"""Exported shaders, run: WGSL, GLSL and HLSL by glslang, Slang by slangc, through wgpu on a Vulkan driver."""

import numpy as np
import pytest
from export_networks import CASES, cases

from warp_neural.export.program import make_program
from warp_neural.export.shaders import SHADERS
from warp_neural.samples.deployment import webgpu

RUN_ON = [case for i, case in enumerate(CASES) if i % 2 == 0 or i >= 26]  # float32, all encodings
RUN_ON += [("elu", "float16"), ("gelu", "float16")]
EVERY = {"wgsl": 1, "glsl": 3, "hlsl": 4, "slang": 5}  # drivers take seconds to compile each
RUNS = [(language, *case) for language, step in EVERY.items() for case in RUN_ON[::step]]


@pytest.mark.parametrize(("language", "name", "precision"), RUNS)
def test_shaders_give_what_python_gives(language, name, precision, tmp_path):
    if lacking := webgpu.missing(language):
        pytest.skip(f"no {lacking}: .ci/tools says how to get it")
    (case, *_) = cases(name, precision)
    program = make_program(case.state)
    source = tmp_path / f"network.{SHADERS[language].suffix}"
    source.write_text(SHADERS[language]().source(program, "a test"))
    code = webgpu.compiled(language, source, tmp_path)
    found, _seconds = webgpu.evaluate(code, program.weights, case.inputs, program.n_out)
    limit = 1e-5 if precision == "float32" else 1e-3  # an exponential off by a bit rounds to the next float16
    np.testing.assert_allclose(found, case.outputs, atol=limit * np.abs(case.outputs).max())

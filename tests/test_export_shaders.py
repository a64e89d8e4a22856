"""Exported shaders, run: WGSL, GLSL and HLSL by glslang, Slang by slangc, through wgpu on a Vulkan driver."""

import os
import shutil
import subprocess
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from export_networks import CASES, cases

from warp_neural.export.program import Program, make_program
from warp_neural.export.shaders import SHADERS

GLSLANG = shutil.which("glslangValidator")
RUN_ON = [case for i, case in enumerate(CASES) if i % 2 == 0 or i >= 26]  # float32, all encodings
RUN_ON += [("elu", "float16"), ("gelu", "float16")]
EVERY = {"wgsl": 1, "glsl": 3, "hlsl": 4, "slang": 5}  # drivers take seconds to compile each
RUNS = [(language, *case) for language, step in EVERY.items() for case in RUN_ON[::step]]


@cache
def gpu():
    """A device of wgpu, or None."""
    if not find_spec("wgpu"):
        return None
    import wgpu

    try:
        return wgpu.gpu.request_adapter_sync().request_device_sync()
    except RuntimeError:
        return None


@cache
def slangc() -> Path | None:
    """The compiler in slangtorch's package, which is not imported: that would need PyTorch."""
    spec = find_spec("slangtorch")
    return Path(spec.origin).parent / "bin" / "slangc" if spec else None


def compiled(language: str, text: str, folder: Path) -> str | bytes:
    """As WebGPU takes it. Slang by WGSL: slangtorch's compiler lacks an optimizer of SPIR-V, on which drivers hang."""
    if language == "wgsl":
        return text
    source, result, environment = folder / f"network.{SHADERS[language].suffix}", folder / "result", dict(os.environ)
    source.write_text(text)
    command = [GLSLANG, "-V", str(source), *(["-D", "-S", "comp", "-e", "main"] if language == "hlsl" else [])]
    if language == "slang":
        slangc().chmod(0o755)
        environment["LD_LIBRARY_PATH"] = str(slangc().parent)
        command = [str(slangc()), str(source), "-target", "wgsl", "-entry", "main", "-stage", "compute"]
    done = subprocess.run([*command, "-o", str(result)], capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr
    return result.read_text() if language == "slang" else result.read_bytes()


def evaluated(code: str | bytes, program: Program, inputs: np.ndarray) -> np.ndarray:
    import wgpu

    device, usage = gpu(), wgpu.BufferUsage
    given = [program.weights, np.ascontiguousarray(inputs)]
    buffers = [device.create_buffer_with_data(data=data, usage=usage.STORAGE) for data in given]
    size = 4 * len(inputs) * program.n_out
    buffers.append(device.create_buffer(size=size, usage=usage.STORAGE | usage.COPY_SRC))
    kernel = {"module": device.create_shader_module(code=code), "entry_point": "main"}
    pipeline = device.create_compute_pipeline(layout="auto", compute=kernel)
    entries = [{"binding": i, "resource": {"buffer": b, "offset": 0, "size": b.size}} for i, b in enumerate(buffers)]
    group = device.create_bind_group(layout=pipeline.get_bind_group_layout(0), entries=entries)
    encoder = device.create_command_encoder()
    commands = encoder.begin_compute_pass()
    commands.set_pipeline(pipeline)
    commands.set_bind_group(0, group)
    commands.dispatch_workgroups(-(-len(inputs) // 64))
    commands.end()
    device.queue.submit([encoder.finish()])
    return np.frombuffer(device.queue.read_buffer(buffers[-1]), np.float32).reshape(len(inputs), -1)


@pytest.mark.parametrize(("language", "name", "precision"), RUNS)
def test_shaders_give_what_python_gives(language, name, precision, tmp_path):
    if gpu() is None:
        pytest.skip("no wgpu with a driver: .ci/tools says how to get both")
    if language == "slang" and not slangc():
        pytest.skip("no slangc: pip install --no-deps slangtorch")
    if language in ("glsl", "hlsl") and not GLSLANG:
        pytest.skip("no glslangValidator: .ci/tools says how to get it")
    (case, *_) = cases(name, precision)
    program = make_program(case.state)
    text = SHADERS[language]().source(program, "a test")
    found = evaluated(compiled(language, text, tmp_path), program, case.inputs)
    limit = 1e-5 if precision == "float32" else 1e-3  # an exponential off by a bit rounds to the next float16
    np.testing.assert_allclose(found, case.outputs, atol=limit * np.abs(case.outputs).max())

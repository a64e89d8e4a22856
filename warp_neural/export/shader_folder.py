"""Folders of shaders: text, weights, and what their README says."""

from dataclasses import dataclass

from warp_neural.export.images import SIDE, USE, image_shader, shows_image
from warp_neural.export.program import Program
from warp_neural.export.shaders import GROUP, SHADERS

DIGITS = {"float32": "within 1e-5 of the largest", "float16": "within what rounding to float16 makes of that, 1e-3"}
USE_SHADER = """`{name}.{suffix}` has a function `evaluate` of one sample, to copy into your shaders, and a compute
entry, `{entry}`, a thread a row in groups of {group}. Buffers: {weights}, 1 inputs, 2
results{count}.

{compile}"""
COMPILE = {
    "glsl": "`glslangValidator -V {name}.comp -o {name}.spv` makes SPIR-V for Vulkan; bindings are of set 0.",
    "hlsl": "`dxc -T cs_6_0 -E main {name}.hlsl -Fo {name}.dxil`; registers are t0, t1 and u2.",
    "slang": "`slangc {name}.slang -target spirv -entry main -stage compute -o {name}.spv`; bindings are of set 0.",
    "wgsl": "WebGPU takes the text as it is; bindings are of group 0.",
    "msl": "`xcrun metal {name}.metal -o {name}.metallib`; buffer 3 is the number of rows, a uint.",
}


@dataclass(frozen=True)
class Forms:
    """Of shaders, see `export`."""

    cooperative: bool = False
    baked: bool = False
    half: bool = False


def shader_files(program: Program, target: str, name: str, about: str, half: bool) -> tuple[dict[str, bytes], str, str]:
    """Files, and what the README says of their use and of the results."""
    suffix, weights = SHADERS[target].suffix, program.weights.astype("<f4")
    files = {f"{name}.{suffix}": SHADERS[target](half).source(program, about).encode()}
    if weights.size:
        files["weights.bin"] = weights.tobytes()
    buffer = "0 weights (`weights.bin`, float32)" if weights.size else "no 0, as weights are constants"
    entry, count = ("rows", ", 3 their number") if target == "msl" else ("main", ", as many as they hold")
    use = USE_SHADER.format(
        name=name,
        suffix=suffix,
        entry=entry,
        group=GROUP,
        count=count,
        weights=buffer,
        compile=COMPILE[target].format(name=name),
    )
    if shows_image(program):
        file, entry = f"{name}_image.{suffix}", "fill" if target == "msl" else "main"
        files[file] = image_shader(target, half).source(program, about).encode()
        use += USE.format(file=file, entry=entry, side=SIDE, weights=f"Bindings: {buffer}")
    return files, use, f"results are {DIGITS[program.precision]}"

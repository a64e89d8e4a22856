"""Cooperative-vector forms of exported shaders, float16: encodings as in the plain form, in float, then a product by
the driver for each layer, with activations in float again. `matrices.bin` has what the products read."""

from dataclasses import dataclass

from warp_neural.errors import InputError
from warp_neural.export.language import INDENT
from warp_neural.export.program import Program, fit_float16
from warp_neural.export.shaders import Glsl, Hlsl, Shader, Slang
from warp_neural.export.statements import For, Let, Set
from warp_neural.kernels.nn import activations

RELU = activations.relu.value
MATRIX, BIAS = 64, 16  # alignment in bytes, as Vulkan asks for
FILE = "matrices.bin"
USE = """

`{file}` is the same network with cooperative vectors:
{about}.
Buffer 3 holds `matrices.bin`, float16: biases, and matrices [rows, columns], row major, which begin at these bytes:

| layer | rows | columns | matrix | bias |
|---|---|---|---|---|
{rows}

{load}
Results are within 1e-2 of the largest."""
_VULKAN = """Convert each matrix to the inferencing-optimal layout when you load it:
`vkConvertCooperativeVectorMatrixNV` tells the size, and converts. Biases stay where they are; matrices follow, at
multiples of 64 bytes, and specialization constants 0 and on are where they begin.
It needs the features cooperativeVector, shaderReplicatedComposites, shaderFloat16 and vulkanMemoryModel.
{by} makes SPIR-V:

    {command}
"""
ABOUT = {
    "glsl": "GL_NV_cooperative_vector, for VK_NV_cooperative_vector",
    "slang": "CoopVec, for VK_NV_cooperative_vector",
    "hlsl": "experimental, as proposed for shader model 6.10 (`dx::linalg`), not tried with a compiler",
}
LOAD = {
    "glsl": _VULKAN.format(
        command="glslangValidator -V --target-env vulkan1.2 {file} -o {name}_cooperative.spv",
        by="Glslang 15 or newer",
    ),
    "slang": _VULKAN.format(
        command="slangc {file} -target spirv -entry main -stage compute -o {name}_cooperative.spv", by="Slang"
    ),
    "hlsl": """Convert each matrix to the layout `MulOptimal` when you load it, as Direct3D 12 offers it for shader
model 6.10. Biases stay where they are; matrices follow, at multiples of 128 bytes, and the constant buffer b0 has where
they begin, a uint each. `dxc -T cs_6_10 -enable-16bit-types -E main {file} -Fo {name}_cooperative.dxil`.""",
}


@dataclass(frozen=True)
class Place:
    """A layer in `matrices.bin`. rows: results; matrix, bias: where they begin, in bytes."""

    rows: int
    columns: int
    matrix: int
    bias: int


def places(program: Program) -> list[Place]:
    """All biases first: those stay where they are when matrices change their layout, and size."""
    layers, biases, end = program.state.spec.layers, [], 0
    for _n_in, n_out in layers:
        biases.append(end)
        end = _aligned(end + 2 * n_out, BIAS)
    found = []
    for (n_in, n_out), bias in zip(layers, biases, strict=True):
        begin = _aligned(end, MATRIX)
        found.append(Place(n_out, n_in, begin, bias))
        end = begin + 2 * n_out * n_in
    return found


def _aligned(size: int, alignment: int) -> int:
    return -(-size // alignment) * alignment


def matrices(program: Program) -> bytes:
    """float16: biases, then weights [n_out, n_in], row major."""
    check(program)
    state, found = program.state, places(program)
    data = bytearray(_aligned(found[-1].matrix + 2 * found[-1].rows * found[-1].columns, MATRIX))
    for place, w, b in zip(found, state.weights, state.biases, strict=True):
        for start, values in ((place.bias, b), (place.matrix, w)):
            part = values.astype("<f2").tobytes()
            data[start : start + len(part)] = part
    return bytes(data)


def check(program: Program) -> None:
    if program.precision != "float16":
        raise InputError(f"cooperative vectors are of float16, not {program.precision}; give precision float16")
    fit_float16("bias", program.state.biases)


def additions(program: Program, target: str, name: str, about: str) -> tuple[dict[str, bytes], str]:
    """Files beside those of the plain form, and what the README says of them."""
    shader = COOPERATIVE[target]()
    file = f"{name}_cooperative.{shader.suffix}"
    rows = (f"| {l} | {e.rows} | {e.columns} | {e.matrix} | {e.bias} |" for l, e in enumerate(places(program)))
    load = LOAD[target].format(file=file, name=name)
    use = USE.format(file=file, about=ABOUT[target], rows="\n".join(rows), load=load)
    return {file: shader.source(program, about).encode(), FILE: matrices(program)}, use


def check_target(target: str, texture: bool) -> None:
    if target not in COOPERATIVE:
        own = "; vulkan has them without asking, of float16" if target == "vulkan" else ""
        raise InputError(f"cooperative: not for {target}; give one of {', '.join(COOPERATIVE)}{own}")
    if texture:
        raise InputError("cooperative: not for textures yet; export without it")


class Cooperative(Shader):
    """product: layer `l`. vector: a declaration; zero: a vector of zeros; unroll: before a loop over components, which
    drivers keep in registers. offset: the declaration of where a matrix begins, which hosts set."""

    matrices: str
    offset: str
    offsets = "{all}"
    using = ""
    vector: str
    zero: str
    product: str
    unroll: str

    def source(self, program: Program, about: str) -> str:
        check(program)
        layers = range(len(program.state.spec.layers))
        offsets = self.offsets.format(all="\n".join(self.offset.format(l=l) for l in layers))
        about_matrices = f"// 3: {FILE}, its matrices in the layout of the device, each from its byte on"
        self.buffers = "\n".join([type(self).buffers, about_matrices, self.matrices, offsets])
        return super().source(program, about)

    def body(self, program: Program) -> str:
        n_in = program.state.spec.sizes[0]
        rounded = For("i_input", n_in, (Set("v0[i_input]", "float16_t(h0[i_input])"),))
        parts = [self.using, self.lines(program.encoded), self._vector(0, n_in), self._components(rounded)]
        for l, place in enumerate(places(program)):
            parts.append(self._vector(l + 1, place.rows))
            product = self.product.format(to=l + 1, l=l, **vars(place))
            parts += [f"{INDENT}{product}\n", self._finish(program, l)]
        return "".join(parts)

    def _finish(self, program: Program, l: int) -> str:
        """The activation; results of the last layer go to `y`."""
        spec, last = program.state.spec, l == len(program.state.spec.layers) - 1
        o, z, value = f"o{l}", f"z{l}", program.activated(l)
        if not last and spec.activation_of(l).name == "linear":
            return ""
        if not last and spec.activation_of(l).value == RELU:  # whole, which is faster
            return f"{INDENT}v{l + 1} = max(v{l + 1}, {self.zero.format(size=spec.layers[l][1])});\n"
        target, result = (f"y[{o}]", value) if last else (f"v{l + 1}[{o}]", f"float16_t({value})")
        each = Let(z, "float", f"float(v{l + 1}[{o}])"), Set(target, result)
        return self._components(For(o, spec.layers[l][1], each))

    def _vector(self, index: int, size: int) -> str:
        return f"{INDENT}{self.vector.format(name=f'v{index}', size=size)}\n"

    def _components(self, loop: For) -> str:
        return f"{INDENT}{self.unroll} {self.line(loop, 1).lstrip()}"


class CooperativeGlsl(Cooperative, Glsl):
    first = """#version 450
#extension GL_NV_cooperative_vector : require
#extension GL_EXT_shader_explicit_arithmetic_types_float16 : require
#extension GL_EXT_control_flow_attributes : require
"""
    matrices = "layout(std430, binding = 3) readonly buffer Matrices { uint matrices[]; };"
    offset = "layout(constant_id = {l}) const uint matrix{l} = 0;"
    vector = "coopvecNV<float16_t, {size}> {name};"
    zero = "coopvecNV<float16_t, {size}>(float16_t(0.0))"
    product = """coopVecMatMulAddNV(v{to}, v{l}, gl_ComponentTypeFloat16NV, matrices, matrix{l},
        gl_ComponentTypeFloat16NV, matrices, {bias}u, gl_ComponentTypeFloat16NV, {rows}u, {columns}u,
        gl_CooperativeVectorMatrixLayoutInferencingOptimalNV, false, 0u);"""
    unroll = "[[unroll]]"


class CooperativeSlang(Cooperative, Slang):
    matrices = "[[vk::binding(3)]] ByteAddressBuffer matrices;"
    offset = "[[vk::constant_id({l})]] const uint matrix{l} = 0;"
    vector = "CoopVec<float16_t, {size}> {name};"
    zero = "CoopVec<float16_t, {size}>(float16_t(0.0))"
    product = """v{to} = coopVecMatMulAdd<float16_t, {rows}, {columns}>(v{l}, CoopVecComponentType.Float16,
        matrices, int(matrix{l}), CoopVecComponentType.Float16, matrices, {bias}, CoopVecComponentType.Float16,
        CoopVecMatrixLayout.InferencingOptimal, false, 0);"""
    unroll = "[unroll]"


class CooperativeHlsl(Cooperative, Hlsl):
    """As proposed for shader model 6.10, HLSL's proposal 0035; there is no compiler of it to try it with yet."""

    first = "#include <dx/linalg.h>\n"
    matrices = "ByteAddressBuffer matrices : register(t3);"
    offsets = "cbuffer Offsets : register(b0) {{\n{all}\n}};"
    offset = INDENT + "uint matrix{l};"
    using = f"{INDENT}using namespace dx::linalg;\n"
    vector = "vector<float16_t, {size}> {name};"
    zero = "(vector<float16_t, {size}>)0"
    product = """VectorRef<ComponentType::F16, {rows}> bias{l} = {{matrices, {bias}}};
    v{to} = MultiplyAdd<float16_t>(
        Matrix<ComponentType::F16, {rows}, {columns}, MatrixUse::A, MatrixScope::Thread>::Load<
            MatrixLayout::MulOptimal>(matrices, matrix{l}, 0),
        v{l}, bias{l});"""
    unroll = "[unroll]"


COOPERATIVE = {"glsl": CooperativeGlsl, "slang": CooperativeSlang, "hlsl": CooperativeHlsl}

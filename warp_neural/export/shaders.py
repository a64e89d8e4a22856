"""Compute shaders in GLSL, HLSL, Slang, WGSL and MSL: a function of one sample, and an entry for rows of them."""

import re

import numpy as np

from warp_neural.export import library, unrolled
from warp_neural.export.language import Language
from warp_neural.export.program import Program
from warp_neural.export.statements import Function, Layer, Statement

GROUP = 64  # threads
ROWS = """// Bindings: 0 weights, float32 of weights.bin; 1 inputs [rows, {n_in}]; 2 outputs [rows, {n_out}], as
// many rows as they hold. A thread a row, groups of {group}."""
OF_WGSL = {"float": "f32", "int": "i32", "uint": "u32"}


class Shader(Language):
    """first: what a file begins with. natives: functions of the language under our names. evaluate, entry: what follows
    these. half: `to_half` by the device's own numbers, and what that asks for at the beginning.

    own_half: of a shader, to take these; drivers need float16 then."""

    suffix: str
    bindings = ROWS
    first = ""
    half: tuple[str, str]
    natives: str
    buffers: str
    evaluate = """
void evaluate(in float x[{n_in}], out float y[{n_out}]) {
BODY
}"""
    entry: str

    def __init__(self, own_half: bool = False):
        self.own_half = own_half

    def source(self, program: Program, about: str, around: str = "", call: tuple[str, str] = ("", "")) -> str:
        """around: a function around `evaluate` of three inputs, which the entry calls; call: how it calls that in place
        of `evaluate`."""
        body, entry = self.body(program), self.entry.replace(*call) if around else self.entry
        first, functions = self.functions(body)
        entry = entry.replace("{n_in}", str(3 if around else program.n_in))
        bindings = self.bindings.replace("{n_in}", "3: u, v, level of detail") if around else self.bindings
        buffers = self.buffers
        if not program.weights.size:  # all are in the text
            bindings = bindings.replace("0 weights, float32 of weights.bin; ", "")
            buffers = "\n".join(line for line in buffers.splitlines() if "weights" not in line)
        parts = [bindings, buffers, self.natives, functions, self.evaluate, around, entry]
        text = "\n".join([first + f"// {about}", *(part.strip("\n") for part in parts if part)])
        for name, value in {"n_in": program.n_in, "n_out": program.n_out, "group": GROUP}.items():
            text = text.replace(f"{{{name}}}", str(value))
        return f"{text.replace('BODY', body.rstrip())}\n"

    def body(self, program: Program) -> str:
        """Of `evaluate`."""
        return self.lines(program.body)

    def functions(self, body: str) -> tuple[str, str]:
        """What the file begins with, and the functions that a body calls."""
        called = [each for each in library.ALL if f"{each.name}(" in body]
        if self.own_half and library.to_half in called:
            rest = "".join(self.function(each) for each in called if each is not library.to_half)
            return self.first + self.half[0], f"{self.half[1]}\n{rest}"
        return self.first, "".join(map(self.function, called))

    def line(self, each: Statement, depth: int) -> str:
        return unrolled.layer(self, each, depth) if isinstance(each, Layer) else super().line(each, depth)

    def vector(self, name: str, values: str) -> str:
        return f"vec4 {name} = vec4({values});"

    def times(self, matrix: np.ndarray, vector: str) -> str:
        return f"mat4({unrolled.literals(matrix.T)}) * {vector}"

    def function(self, each: Function) -> str:
        arguments = ", ".join(f"float {name}" for name in each.arguments)
        return f"float {each.name}({arguments}) {{\n{self.lines(each.body)}    return {each.result};\n}}\n"


class Glsl(Shader):
    suffix = "comp"
    first = "#version 450\n"
    half = (
        "#extension GL_EXT_shader_explicit_arithmetic_types_float16 : require\n",
        "float to_half(float z) { return float(float16_t(z)); }",
    )
    buffers = """layout(local_size_x = {group}) in;
layout(std430, binding = 0) readonly buffer Weights { float weights[]; };
layout(std430, binding = 1) readonly buffer Inputs { float inputs[]; };
layout(std430, binding = 2) buffer Outputs { float outputs[]; };"""
    natives = """
float pick(bool condition, float a, float b) { return condition ? a : b; }
float multiply_add(float a, float b, float c) { return fma(a, b, c); }
float nearest(float z) { return roundEven(z); }
uint bits_of(float z) { return floatBitsToUint(z); }
float float_of(uint bits) { return uintBitsToFloat(bits); }"""
    entry = """
void main() {
    uint row = gl_GlobalInvocationID.x;
    if (row >= uint(outputs.length()) / {n_out}u) return;
    float x[{n_in}], y[{n_out}];
    for (int i = 0; i < {n_in}; ++i) x[i] = inputs[row * {n_in}u + uint(i)];
    evaluate(x, y);
    for (int i = 0; i < {n_out}; ++i) outputs[row * {n_out}u + uint(i)] = y[i];
}"""

    def constant(self, name: str, type: str, value: str) -> str:
        return f"{type} {name} = {value};"  # const would ask for a constant expression in older versions


class Hlsl(Shader):
    suffix = "hlsl"
    half = "", "float to_half(float z) { return float(float16_t(z)); }"
    buffers = """StructuredBuffer<float> weights : register(t0);
StructuredBuffer<float> inputs : register(t1);
RWStructuredBuffer<float> outputs : register(u2);"""
    natives = """
float pick(bool condition, float a, float b) { return condition ? a : b; }
float multiply_add(float a, float b, float c) { return mad(a, b, c); }
float nearest(float z) { return round(z); }
uint bits_of(float z) { return asuint(z); }
float float_of(uint bits) { return asfloat(bits); }"""
    entry = """
[numthreads({group}, 1, 1)]
void main(uint3 thread : SV_DispatchThreadID) {
    uint count, stride;
    outputs.GetDimensions(count, stride);
    if (thread.x >= count / {n_out}u) return;
    float x[{n_in}], y[{n_out}];
    for (int from = 0; from < {n_in}; ++from) x[from] = inputs[thread.x * {n_in}u + uint(from)];
    evaluate(x, y);
    for (int to = 0; to < {n_out}; ++to) outputs[thread.x * {n_out}u + uint(to)] = y[to];
}"""

    def vector(self, name: str, values: str) -> str:
        return f"float4 {name} = float4({values});"

    def times(self, matrix: np.ndarray, vector: str) -> str:
        return f"mul(float4x4({unrolled.literals(matrix)}), {vector})"


class Slang(Hlsl):
    suffix = "slang"
    buffers = re.sub(r"(\w+ *<float> \w+) : register\(.(\d)\);", r"[[vk::binding(\2)]] \1;", Hlsl.buffers)
    entry = Hlsl.entry.replace("[numthreads", '[shader("compute")]\n[numthreads')


class Wgsl(Shader):
    suffix = "wgsl"
    half = "enable f16;\n", "fn to_half(z: f32) -> f32 { return f32(f16(z)); }"
    buffers = """@group(0) @binding(0) var<storage, read> weights: array<f32>;
@group(0) @binding(1) var<storage, read> inputs: array<f32>;
@group(0) @binding(2) var<storage, read_write> outputs: array<f32>;"""
    natives = """
fn pick(condition: bool, a: f32, b: f32) -> f32 { return select(b, a, condition); }
fn multiply_add(a: f32, b: f32, c: f32) -> f32 { return fma(a, b, c); }
fn nearest(z: f32) -> f32 { return round(z); }
fn bits_of(z: f32) -> u32 { return bitcast<u32>(z); }
fn float_of(bits: u32) -> f32 { return bitcast<f32>(bits); }"""
    evaluate = """
fn evaluate(x: array<f32, {n_in}>) -> array<f32, {n_out}> {
    var y: array<f32, {n_out}>;
BODY
    return y;
}"""
    entry = """
@compute @workgroup_size({group})
fn main(@builtin(global_invocation_id) thread: vec3<u32>) {
    let row = thread.x;
    if (row >= arrayLength(&outputs) / {n_out}u) { return; }
    var x: array<f32, {n_in}>;
    for (var i = 0u; i < {n_in}u; i++) { x[i] = inputs[row * {n_in}u + i]; }
    var y = evaluate(x);
    for (var i = 0u; i < {n_out}u; i++) { outputs[row * {n_out}u + i] = y[i]; }
}"""

    def typed(self, expression: str) -> str:
        return re.sub(r"\b(float|uint|int)\(", lambda match: f"{OF_WGSL[match[1]]}(", expression)

    def constant(self, name: str, type: str, value: str) -> str:
        return f"let {name}: {OF_WGSL[type]} = {self.typed(value)};"

    def variable(self, name: str, type: str, value: str) -> str:
        return f"var {name}: {OF_WGSL[type]} = {self.typed(value)};"

    def array(self, name: str, size: int) -> str:
        return f"var {name}: array<f32, {size}>;"

    def set(self, target: str, value: str) -> str:
        return f"{target} = {self.typed(value)};"

    def vector(self, name: str, values: str) -> str:
        return f"var {name} = vec4<f32>({values});"

    def times(self, matrix: np.ndarray, vector: str) -> str:
        return f"mat4x4<f32>({unrolled.literals(matrix.T)}) * {vector}"

    def loop(self, name: str, count: int) -> str:
        return f"for (var {name}: i32 = 0; {name} < {count}; {name}++)"

    def function(self, each: Function) -> str:
        arguments = ", ".join(f"{name}: f32" for name in each.arguments)
        body = f"{self.lines(each.body)}    return {self.typed(each.result)};\n"
        return f"fn {each.name}({arguments}) -> f32 {{\n{body}}}\n"


class Msl(Shader):
    suffix = "metal"
    half = "", "inline float to_half(float z) { return float(half(z)); }"
    buffers = "#include <metal_stdlib>\nusing namespace metal;"
    natives = """
inline float pick(bool condition, float a, float b) { return condition ? a : b; }
inline float multiply_add(float a, float b, float c) { return fma(a, b, c); }
inline float nearest(float z) { return rint(z); }
inline uint bits_of(float z) { return as_type<uint>(z); }
inline float float_of(uint bits) { return as_type<float>(bits); }"""
    evaluate = """
inline void evaluate(device const float* weights, thread const float* x, thread float* y) {
BODY
}"""
    entry = """
kernel void rows(device const float* weights [[buffer(0)]], device const float* inputs [[buffer(1)]],
                 device float* outputs [[buffer(2)]], constant uint& count [[buffer(3)]],
                 uint row [[thread_position_in_grid]]) {
    if (row >= count) return;
    float x[{n_in}], y[{n_out}];
    for (uint i = 0; i < {n_in}; ++i) x[i] = inputs[row * {n_in} + i];
    evaluate(weights, x, y);
    for (uint i = 0; i < {n_out}; ++i) outputs[row * {n_out} + i] = y[i];
}"""

    def vector(self, name: str, values: str) -> str:
        return f"float4 {name} = float4({values});"

    def times(self, matrix: np.ndarray, vector: str) -> str:
        return f"float4x4({unrolled.literals(matrix.T)}) * {vector}"

    def function(self, each: Function) -> str:
        return f"inline {super().function(each)}"


SHADERS = {"glsl": Glsl, "hlsl": Hlsl, "slang": Slang, "wgsl": Wgsl, "msl": Msl}

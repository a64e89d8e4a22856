"""A folder for Vulkan: SPIR-V, the shaders' text, and a C++ program that runs, compares and times them."""

from zlib import crc32

from warp_neural.export import spirv
from warp_neural.export.cooperative import FILE, additions, places
from warp_neural.export.cpp import TEXT, named
from warp_neural.export.program import Program
from warp_neural.export.shaders import GROUP, Glsl

SOURCES = "main.cpp", "device.hpp", "pipeline.hpp", "cooperative.hpp", "CMakeLists.txt"
NAMED = "main.cpp", "CMakeLists.txt"
TOLERANCE = {"float32": 1e-5, "float16": 1e-3}
COOPERATIVE_TOLERANCE = 1e-2  # drivers may sum in float16, and biases are float16 too

HEADER = """// {about}
#pragma once
#include <cstddef>
#include <cstdint>

namespace network {{

inline constexpr std::uint32_t inputs = {n_in}, outputs = {n_out}, group = {group};
inline constexpr char hash[] = "{digest}";

// sum: CRC-32
struct File {{
    const char* name;
    std::size_t size;
    std::uint32_t sum;
}};
inline constexpr File weights = {{"weights.bin", {weights}}};
inline constexpr File matrices = {{"{file}", {matrices}}};

// How far results may be from Python's, of the largest.
inline constexpr double tolerance = {tolerance}, cooperative_tolerance = {cooperative_tolerance};
inline constexpr bool cooperative = {cooperative};

// matrix, bias: where they begin in {file}, in bytes
struct Layer {{
    std::uint32_t rows, columns;
    std::size_t matrix, bias;
}};
inline constexpr Layer layers[] = {{
{layers}}};

}}  // namespace network
"""
USE = """`{name}.spv` is the network as a compute shader in SPIR-V, `{name}.comp` its text: entry `main`, a thread a
row, groups of {group}. Buffers of set 0: 0 weights (`weights.bin`, float32), 1 inputs, 2 results, as many rows as they
hold.

`main.cpp` and the headers beside it are a C++17 program that loads Vulkan when it runs, evaluates the rows below,
compares, and times 65,536 of them. It needs Vulkan's headers to build (libvulkan-dev, the Vulkan SDK, or
github.com/KhronosGroup/Vulkan-Headers), any of 1.2 and newer, and a driver to run:

    cmake -B build && cmake --build build && ctest --test-dir build

builds and runs it; so does `g++ -std=c++17 -O2 main.cpp -ldl && ./a.out`. It prints the devices; `--device N` takes
one, `--rows N` times others than 65,536, `--plain` does without cooperative vectors. Exit code 1: results are off; 2:
refused; 77: there is no Vulkan. NVIDIA's driver without a display may need a JSON file in VK_DRIVER_FILES that
names libEGL_nvidia.so.0.{also}"""
ALSO = """

`{name}_cooperative.spv` is for devices with VK_NV_cooperative_vector, and the program takes it there; for your own
programs, `cooperative.hpp` has what follows.{use}"""


def project(program: Program, name: str, about: str) -> tuple[dict[str, bytes], str, str]:
    """Files, and what the README says of their use and of the results."""
    halves, weights = program.precision == "float16", program.weights.astype("<f4").tobytes()
    files = {f"{name}.spv": spirv.plain(program, about), f"{name}.comp": Glsl().source(program, about).encode()}
    files["weights.bin"] = weights
    also = ""
    if halves:
        files[f"{name}_cooperative.spv"] = spirv.cooperative(program, about)
        more, use = additions(program, "glsl", name, about)
        files, also = files | more, ALSO.format(name=name, use=use)
    for file in SOURCES:
        text = (TEXT / "vulkan" / file).read_text()
        if file in NAMED:
            text = named(text, name)
        files[file] = text.encode()
    files["network.hpp"] = header(program, about, weights, files.get(FILE, b"")).encode()
    compared = f"results are within {TOLERANCE[program.precision]:g} of the largest"
    compared += f", with cooperative vectors {COOPERATIVE_TOLERANCE:g}" if halves else ""
    return files, USE.format(name=name, group=GROUP, also=also), compared


def header(program: Program, about: str, weights: bytes, products: bytes) -> str:
    """products: what `matrices.bin` holds."""
    layers = (f"    {{{each.rows}, {each.columns}, {each.matrix}, {each.bias}}},\n" for each in places(program))
    return HEADER.format(
        about=about,
        n_in=program.n_in,
        n_out=program.n_out,
        group=GROUP,
        digest=program.digest,
        weights=f"{len(weights)}, {crc32(weights):#010x}u",
        matrices=f"{len(products)}, {crc32(products):#010x}u",
        file=FILE,
        tolerance=TOLERANCE[program.precision],
        cooperative_tolerance=COOPERATIVE_TOLERANCE,
        cooperative="true" if products else "false",
        layers="".join(layers),
    )

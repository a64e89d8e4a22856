"""The CUDA text of decoding tiles, run by a warp on the host: `native/warp.h` and a C++20 compiler instead of a GPU."""

import ctypes
import re
import subprocess
from pathlib import Path

import numpy as np

HEADER = Path(__file__).parent / "native" / "warp.h"
PTX = {"cvt.rn.f16x2.f32": "ptx_pack", "max.f16x2": "ptx_max", "min.f16x2": "ptx_min", "fma.rn.f16x2": "ptx_fma"}
TILES = """#include "%s"
extern "C" void tiles(const Params* all, unsigned* words, unsigned* packed, float* terms, int mip, const int* inside,
                      float* out) {
    std::vector<std::thread> lanes;
    for (unsigned i = 0; i < 32; ++i) lanes.emplace_back([=] {
        threadIdx.x = i;
        const Params params = *all;
        const Array<unsigned> tables{words}, weights{packed};
        const Array<float> biases{terms}, values{out};
        const Vec4i rectangle{inside[0], inside[1], inside[2], inside[3]};
        for (int top = inside[1] / 4 * 4; top < inside[1] + inside[3]; top += 4)
            for (int left = inside[0] / 8 * 8; left < inside[0] + inside[2]; left += 8) [&] { %s }();
    });
    for (auto& lane : lanes) lane.join();
}
"""


def on_host(text: str) -> str:
    """With functions in place of the instructions that decoding has; others, which it does not call, give 0."""
    text = re.sub(r'asm\("mma.*?\); };', "ptx_mma(d, c, a, b0, b1); };", text, flags=re.DOTALL)
    text = re.sub(r'asm\("ex2[^;]*;[^;]*;', "e = ptx_ex2(e);", text)

    def call(match: re.Match) -> str:
        operands = ", ".join(re.findall(r'"[rf]"\((\w+)\)', match[2]))
        return f"r = {PTX[match[1]]}({operands});" if match[1] in PTX else "r = 0;"

    return re.sub(r'asm\("([\w.{]+)[^"]*" : "=[rf]"\(r\) :([^;]*);', call, text)


def decode(tensor, text: str, folder: Path, mip: int, rectangle: tuple[int, int, int, int]) -> np.ndarray:
    """float32 [height, width, channels] of a `TensorDecoder` on the CPU. text: of its tiles, to float."""
    source, library = folder / "tiles.cpp", folder / "tiles.so"
    source.write_text(TILES % (HEADER, on_host(text)))
    options = ["-std=c++20", "-O1", "-w", "-fpermissive", "-shared", "-fPIC", "-pthread"]
    subprocess.run(["g++", *options, str(source), "-o", str(library)], check=True)
    params, layout = tensor.params, tensor.layout
    arrays = [params.levels.rows, params.levels.columns, params.latents, params.starts]
    addresses = np.array([array.ptr for array in arrays], np.uint64)
    assert not any(array.ptr % 16 for array in (tensor.tables, tensor.weights, tensor.biases))
    values = np.full((rectangle[3], rectangle[2], layout.spec.channels), np.nan, np.float32)
    inside = np.array(rectangle, np.int32)
    places = [addresses.ctypes.data, tensor.tables.ptr, tensor.weights.ptr, tensor.biases.ptr]
    arguments = [*map(ctypes.c_void_p, places), mip, *(ctypes.c_void_p(a.ctypes.data) for a in (inside, values))]
    ctypes.CDLL(str(library)).tiles(*arguments)
    return values

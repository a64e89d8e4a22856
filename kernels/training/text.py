"""CUDA text that the rooms of fused training share. Names as in `kernels.coopvec.cuda.fragments`."""

from collections.abc import Callable

from warp_neural.kernels.nn.spec import C_TYPES, FLOAT16, NetworkSpec

MEMORY = """
auto load = [](unsigned address, unsigned (&w)[4]) {
    asm volatile("ldmatrix.sync.aligned.m8n8.x4.shared.b16 {%0,%1,%2,%3},[%4];"
        : "=r"(w[0]), "=r"(w[1]), "=r"(w[2]), "=r"(w[3]) : "r"(address) : "memory");
};
auto load_transposed = [](unsigned address, unsigned (&w)[4]) {
    asm volatile("ldmatrix.sync.aligned.m8n8.x4.trans.shared.b16 {%0,%1,%2,%3},[%4];"
        : "=r"(w[0]), "=r"(w[1]), "=r"(w[2]), "=r"(w[3]) : "r"(address) : "memory");
};
auto save = [&](unsigned address, const unsigned (&w)[4]) {
#if __CUDA_ARCH__ >= 900
    asm volatile("stmatrix.sync.aligned.m8n8.x4.shared.b16 [%0],{%1,%2,%3,%4};"
        :: "r"(address), "r"(w[0]), "r"(w[1]), "r"(w[2]), "r"(w[3]) : "memory");
#else
    for (int r = 0; r < 4; ++r)
        asm volatile("st.shared.b32 [%0],%1;" :: "r"(address - lane * 12 + 128 * r), "r"(w[r]) : "memory");
#endif
};
auto save_unit = [](unsigned address, unsigned x, unsigned y, unsigned z, unsigned w) {
    asm volatile("st.shared.v4.b32 [%0],{%1,%2,%3,%4};" :: "r"(address), "r"(x), "r"(y), "r"(z), "r"(w) : "memory");
};
auto load_unit = [](unsigned address, unsigned (&w)[4]) {
    asm volatile("ld.shared.v4.b32 {%0,%1,%2,%3},[%4];"
        : "=r"(w[0]), "=r"(w[1]), "=r"(w[2]), "=r"(w[3]) : "r"(address) : "memory");
};
auto spread_signs = [](unsigned v) { unsigned r;  // of each half over all its bits
    asm("prmt.b32 %0,%1,0,0xbb99;" : "=r"(r) : "r"(v)); return r; };
"""


def ones_of(spec: NetworkSpec) -> str:
    """Two, in one register."""
    return "0x3c003c00u" if spec.format is FLOAT16 else "0x3f803f80u"


def slopes(spec: NetworkSpec) -> str:
    """Lambdas: the derivatives of the activations."""
    return "".join(
        f"auto d_{name} = [](real z) -> real {{ return {activation.derivative}; }};\n"
        for name, activation in (("hidden", spec.activation), ("last", spec.output_activation))
    )


def take_dx(n_in: int, dtype: type, address: Callable[[int], str]) -> str:
    """`dx`, from 16-byte units of 8 elements each at `address(unit)`."""
    text = f"wp::vec_t<{n_in}, {C_TYPES[dtype]}> dx;\n"
    for u in range(-(-n_in // 8)):
        text += f"{{ unsigned v[4]; load_unit({address(u)}, v);\n"
        for k in range(8 * u, min(8 * u + 8, n_in)):
            text += f"dx.c[{k}] = {C_TYPES[dtype]}({('low', 'high')[k % 2]}(v[{k % 8 // 2}]));\n"
        text += "}\n"
    return text

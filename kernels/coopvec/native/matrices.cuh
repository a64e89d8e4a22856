// Vectors in shared memory, as 8 x 8 matrices of 16-bit elements; addresses are in bytes, one for each lane.
// Names: lane.

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
#pragma unroll
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

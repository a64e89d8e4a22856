// Vectors of 16 floats; the compiler splits them where registers are shorter.

using real = wp::float32;
typedef real v16 __attribute__((ext_vector_type(16)));
typedef unsigned u16 __attribute__((ext_vector_type(16)));
typedef _Float16 h16 __attribute__((ext_vector_type(16)));
const auto load = [](const real* p) { return *reinterpret_cast<const v16*>(p); };
const auto store = [](real* p, v16 z) { *reinterpret_cast<v16*>(p) = z; };
const auto fma = [](v16 x, v16 y, v16 z) { return __builtin_elementwise_fma(x, y, z); };
const auto bits = [](v16 z) { return __builtin_bit_cast(u16, z); };
const auto value = [](u16 b) { return __builtin_bit_cast(v16, b); };
const auto half = [](v16 z) { return __builtin_convertvector(__builtin_convertvector(z, h16), v16); };

// So much of GLSL, Slang and HLSL that networks with cooperative vectors are C++; every layout is row major.
#include <cmath>
#include <cstring>

using std::abs, std::cos, std::exp, std::floor, std::fma, std::log, std::sin, std::sqrt, std::tanh;
using uint = unsigned;
using float16_t = _Float16;
#define in
#define out

inline float min(float a, float b) { return b < a ? b : a; }
inline int min(int a, int b) { return b < a ? b : a; }
inline float max(float a, float b) { return a < b ? b : a; }
template <class To, class From> To bits_as(From from) {
    To to;
    std::memcpy(&to, &from, sizeof(to));
    return to;
}
// GLSL's names, then HLSL's
inline float roundEven(float z) { return std::nearbyint(z); }
inline uint floatBitsToUint(float z) { return bits_as<uint>(z); }
inline float uintBitsToFloat(uint bits) { return bits_as<float>(bits); }
inline float round_even(float z) { return std::nearbyint(z); }
#define round round_even
inline float mad(float a, float b, float c) { return std::fma(a, b, c); }
inline uint asuint(float z) { return bits_as<uint>(z); }
inline float asfloat(uint bits) { return bits_as<float>(bits); }

template <class T, int N> struct coopvecNV {
    T values[N];
    coopvecNV() = default;
    explicit coopvecNV(T value) {
        for (T& each : values) each = value;
    }
    T& operator[](int i) { return values[i]; }
};
template <class T, int N> coopvecNV<T, N> max(coopvecNV<T, N> a, coopvecNV<T, N> b) {
    for (int i = 0; i < N; ++i) a[i] = b[i] < a[i] ? a[i] : b[i];
    return a;
}
template <class T, int N> using CoopVec = coopvecNV<T, N>;
template <class T, int N> using vector = coopvecNV<T, N>;

using Bytes = const char*;
template <class T, int M, int K> coopvecNV<T, M> product(coopvecNV<T, K> x, Bytes matrix, Bytes bias) {
    coopvecNV<T, M> y;
    for (int m = 0; m < M; ++m) {
        T each;
        std::memcpy(&each, bias + m * sizeof(T), sizeof(T));
        float sum = each;
        for (int k = 0; k < K; ++k) {
            std::memcpy(&each, matrix + (m * K + k) * sizeof(T), sizeof(T));
            sum += float(each) * float(x[k]);
        }
        y[m] = T(sum);
    }
    return y;
}

constexpr int gl_ComponentTypeFloat16NV = 0, gl_CooperativeVectorMatrixLayoutInferencingOptimalNV = 2;
template <class T, int M, int K>
void coopVecMatMulAddNV(coopvecNV<T, M>& y, coopvecNV<T, K> x, int type, Bytes matrices, uint matrix, int of_matrix,
                        Bytes biases, uint bias, int of_bias, uint rows, uint columns, int layout, bool transposed,
                        uint) {
    if (rows != M || columns != K || type + of_matrix + of_bias || layout != 2 || transposed) std::abort();
    if (matrix % 64 || bias % 16) std::abort();
    y = product<T, M>(x, matrices + matrix, biases + bias);
}

struct {
    int Float16 = 1;
} CoopVecComponentType;
struct {
    int InferencingOptimal = 1;
} CoopVecMatrixLayout;
template <class T, int M, int K>
coopvecNV<T, M> coopVecMatMulAdd(coopvecNV<T, K> x, int type, Bytes matrices, int matrix, int of_matrix, Bytes biases,
                                 int bias, int of_bias, int layout, bool transposed, int) {
    if (type + of_matrix + of_bias + layout != 4 || transposed || matrix % 64 || bias % 16) std::abort();
    return product<T, M>(x, matrices + matrix, biases + bias);
}

namespace dx::linalg {
enum class ComponentType { F16 };
enum class MatrixUse { A };
enum class MatrixScope { Thread };
enum class MatrixLayout { MulOptimal };
template <ComponentType, int N> struct VectorRef {
    Bytes buffer;
    uint offset;
};
template <ComponentType, int M, int K, MatrixUse, MatrixScope> struct Matrix {
    Bytes data;
    template <MatrixLayout> static Matrix Load(Bytes buffer, uint offset, uint) { return {buffer + offset}; }
};
template <class T, ComponentType C, int M, int K, MatrixUse U, MatrixScope S>
vector<T, M> MultiplyAdd(Matrix<C, M, K, U, S> matrix, vector<T, K> x, VectorRef<C, M> bias) {
    return product<T, M>(x, matrix.data, bias.buffer + bias.offset);
}
}

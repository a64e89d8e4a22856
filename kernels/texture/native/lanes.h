// Channels side by side: eight in a vector of a CPU; in CUDA one in each lane of a warp, of which all lanes run this
// text. An `Eight` has a number of each, an array of `vectors` of them those of all; of(values, c) is channel c of it.
// look_up(table, at, results, v), later looked_up(table, at, results, c): the lanes of CUDA read their entries
// of a table together, a CPU each when it is asked for. What is stored, the lane alone reads that stored it.
// Names: channels.

const int n = channels, width = (n + 7) & ~7;  // of rows of a context, which have zeros between
#if defined(__CUDA_ARCH__)
typedef int Eight;
constexpr int VECTORS = 1;
const int vectors = 1, lane = threadIdx.x & 31, own = lane < width ? lane : 0;
const auto load = [=](const int* row, int) -> Eight { return row[own]; };
const auto load_bytes = [=](const signed char* row, int) -> Eight { return row[own]; };
const auto store = [=](int* row, int, Eight x) {
    if (lane < width) row[lane] = x;
};
const auto store_bytes = [=](signed char* row, int first, unsigned long long eight) {
    if (first <= lane && lane < first + 8) row[lane] = (signed char)(eight >> 8 * (lane - first));
};
const auto of = [](const Eight* values, int c) { return __shfl_sync(~0u, values[0], c); };
const auto look_up = [](const int* table, const Eight* at, Eight* results, int) { results[0] = table[at[0]]; };
const auto looked_up = [=](const int*, const Eight*, const Eight* results, int c) { return of(results, c); };
const auto magnitude = [](Eight x) { return abs(x); };
const auto between = [](int low, Eight x, int high) { return min(max(x, low), high); };
const auto float_bits = [](Eight x) { return __float_as_int((float)x); };
#else
typedef int Eight __attribute__((vector_size(32), aligned(4), may_alias));
typedef float EightFloats __attribute__((vector_size(32)));
typedef signed char EightBytes __attribute__((vector_size(8), aligned(1), may_alias));
constexpr int VECTORS = 4;
const int vectors = width / 8;
const auto load = [](const int* row, int v) { return ((const Eight*)row)[v]; };
const auto load_bytes = [](const signed char* row, int v) {
    return __builtin_convertvector(((const EightBytes*)row)[v], Eight);
};
const auto store = [](int* row, int v, Eight x) { ((Eight*)row)[v] = x; };
const auto store_bytes = [](signed char* row, int first, unsigned long long eight) {
    __builtin_memcpy(row + first, &eight, 8);
};
const auto of = [](const Eight* values, int c) { return ((const int*)values)[c]; };
const auto look_up = [](const int*, const Eight*, Eight*, int) {};
const auto looked_up = [=](const int* table, const Eight* at, const Eight*, int c) { return table[of(at, c)]; };
const auto magnitude = [](Eight x) -> Eight { return __builtin_elementwise_abs(x); };
const auto between = [](int low, Eight x, int high) -> Eight {
    return __builtin_elementwise_min(__builtin_elementwise_max(x, Eight{} + low), Eight{} + high);
};
const auto float_bits = [](Eight x) { return (Eight)__builtin_convertvector(x, EightFloats); };
#endif

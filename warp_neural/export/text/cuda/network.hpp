// ABOUT
// `NAME::Network` evaluates rows of memory on a CUDA device, by the kernels that lie beside this file. C++17.
#pragma once
#include <algorithm>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>
#include <vector>

#include "driver.hpp"

namespace NAME {

inline constexpr int inputs = INPUTS, outputs = OUTPUTS;
inline constexpr int networks = NETWORKS;  // in weights.bin
inline constexpr char hash[] = "HASH", precision[] = "PRECISION";
inline constexpr double flops = FLOPS;  // of one row
inline constexpr double tolerance = TOLERANCE;  // what rounding explains between devices: RMS, of that of the results

using Element = ELEMENT;  // of rows: float, or the bits of a float16

namespace detail {

enum class Kind { pack, rows, groups };

// arch: of the device, "groups" for it alone. ptx: text, for it and all newer ones.
struct Binary {
    Kind kind;
    int arch;
    bool ptx;
    const char *file, *function;
};
inline constexpr Binary binaries[] = {
BINARIES};

inline constexpr int words = WORDS, master = MASTER, steps = STEPS, of_one = PARAMETERS, kind = KIND;
inline constexpr std::int32_t layers[][8] = {LAYERS};
inline constexpr int row_threads = ROW_THREADS, pack_threads = 256;
// of `groups`: threads of a block, rows that it takes at a time, blocks of a multiprocessor, bytes of shared memory
inline constexpr int group_threads = GROUP_THREADS, group_rows = GROUP_ROWS, group_blocks = GROUP_BLOCKS;
inline constexpr int group_bytes = GROUP_BYTES;

// Arguments of the kernels, as Warp lays them out.
struct Array {
    std::uint64_t data = 0, gradient = 0;
    std::int32_t shape[4] = {}, strides[4] = {};
    std::uint16_t dimensions = 0, flags = 0;
};
struct Parameters {
    Array packed, master;
    std::int32_t network, count, kind;
};
template <int N>
struct Bounds {
    std::uint32_t shape[N];
    std::size_t size, divisor;
};
static_assert(sizeof(Array) == ARRAY_BYTES && sizeof(Parameters) == PARAMETERS_BYTES);
static_assert(sizeof(Bounds<1>) == BOUNDS_BYTES);

template <int N>
Array array(cuda::Pointer data, const int (&shape)[N], int size) {
    Array result;
    result.data = data;
    result.dimensions = N;
    for (int i = N - 1; i >= 0; size *= shape[i--]) {
        result.shape[i] = shape[i];
        result.strides[i] = size;
    }
    return result;
}

inline std::vector<char> read(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    if (!file) throw std::invalid_argument(path + ": cannot be read; give the exported folder");
    return {std::istreambuf_iterator<char>(file), {}};
}

// The newest of a kind that a device takes; none: null.
inline const Binary* choose(Kind kind, int arch) {
    const Binary* best = nullptr;
    for (const Binary& each : binaries) {
        const bool same = each.arch / 10 == arch / 10 && (each.arch == arch || kind != Kind::groups);
        if (each.kind != kind || each.arch > arch || !(each.ptx || same)) continue;
        if (!best || best->ptx > each.ptx || (best->ptx == each.ptx && best->arch < each.arch)) best = &each;
    }
    return best;
}

// float32 of weights.bin: of each network and layer weights, [outputs, inputs] row major, and biases; then the
// encoding's parameters; then the steps of INT8.
inline std::vector<float> read_weights(const std::string& path) {
    const std::vector<char> bytes = read(path);
    std::vector<float> values(master + steps);
    if (bytes.size() != values.size() * sizeof(float))
        throw std::invalid_argument(path + ": " + std::to_string(bytes.size()) + " bytes, not " +
                                    std::to_string(values.size() * sizeof(float)) + "; export the network again");
    std::memcpy(values.data(), bytes.data(), bytes.size());
    return values;
}

}  // namespace detail

// The networks of a folder on one device, whose primary context becomes the current one of the calling thread.
class Network {
  public:
    // Throws cuda::Unavailable for a device that the kernels do not run on, std::invalid_argument for broken files.
    Network(const cuda::Driver& driver, const std::string& folder, int device = 0)
        : driver(driver), processors(driver.processors(device)) {
        using namespace detail;
        const std::vector<float> weights = read_weights(folder + "/weights.bin");
        cuda::Context context;
        driver.check(driver.retain(&context, device), "the device's context");
        driver.check(driver.set_current(context), "the device's context");
        const int arch = driver.arch(device);
        const cuda::Function pack = load(folder, Kind::pack, arch);
        rows_function = load(folder, Kind::rows, arch);
        if (!pack || !rows_function)
            throw cuda::Unavailable("no kernel here is for compute capability " + std::to_string(arch / 10) + "." +
                                    std::to_string(arch % 10) + "; export with --arch " + std::to_string(arch));
        groups_function = load(folder, Kind::groups, arch);
        if (groups_function)  // more shared memory than kernels have unasked
            driver.check(driver.function_attribute(groups_function, 8, group_bytes), "shared memory");

        parameters = std::make_unique<cuda::Memory<float>>(driver, weights.data(), weights.size());
        packed = std::make_unique<cuda::Memory<std::uint32_t>>(driver, static_cast<std::size_t>(networks) * words);
        const int count = sizeof(layers) / sizeof(layers[0]);
        const cuda::Memory<std::int32_t> table(driver, &layers[0][0], 8 * count);
        Bounds<2> bounds = {{networks, words}, static_cast<std::size_t>(networks) * words, 1};
        Array layer_array = array(table.pointer, {count, 8}, 4), master_array = array(parameters->pointer, {master}, 4);
        Array step_array = array(parameters->pointer + 4 * static_cast<std::size_t>(master), {networks, count, 2}, 4);
        Array packed_array = array(packed->pointer, {networks * words}, 4);
        int size = of_one, stride = words;
        void* arguments[] = {&bounds, &layer_array, &step_array, &master_array, &size, &packed_array, &stride};
        launch(pack, (bounds.size + pack_threads - 1) / pack_threads, pack_threads, 0, nullptr, arguments);
        driver.check(driver.synchronize(), "the conversion of the weights");
    }

    // Whether whole warpgroups evaluate together (Hopper).
    bool by_warpgroups() const { return groups_function != nullptr; }

    // Network number `network` of each row of x [rows, inputs], to y [rows, outputs]: dense, in memory of the device,
    // fastest where x is aligned to 16 bytes. Returns before it is done, as launches do.
    void evaluate(cuda::Pointer x, cuda::Pointer y, int rows, int network = 0, cuda::Stream stream = nullptr) const {
        using namespace detail;
        if (rows <= 0) return;
        if (network < 0 || network >= networks) throw std::invalid_argument("network: there is none of this number");
        const bool groups = groups_function && x % 16 == 0;
        const unsigned needed = (static_cast<unsigned>(rows) + (groups ? group_rows : row_threads) - 1) /
                                (groups ? group_rows : row_threads);
        const unsigned blocks = groups ? std::min<unsigned>(needed, processors * group_blocks) : needed;
        const unsigned threads = groups ? group_threads : row_threads;
        Bounds<1> bounds = {{blocks * threads}, static_cast<std::size_t>(blocks) * threads, 1};
        Parameters both = {array(packed->pointer, {networks * words}, 4), array(parameters->pointer, {master}, 4),
                           network, networks, kind};
        Array from = array(x, {rows, inputs}, sizeof(Element)), to = array(y, {rows, outputs}, sizeof(Element));
        void* arguments[] = {&bounds, &both, &from, &to};
        launch(groups ? groups_function : rows_function, blocks, threads, groups ? group_bytes : 0, stream, arguments);
    }

  private:
    cuda::Function load(const std::string& folder, detail::Kind kind, int arch) const {
        const detail::Binary* const binary = detail::choose(kind, arch);
        if (!binary) return nullptr;
        std::vector<char> code = detail::read(folder + "/" + binary->file);
        code.push_back(0);  // text ends with it
        cuda::Module module;
        cuda::Function function;
        driver.check(driver.module_load(&module, code.data()), binary->file);
        driver.check(driver.module_function(&function, module, binary->function), binary->function);
        return function;
    }

    void launch(cuda::Function function, std::size_t blocks, unsigned threads, unsigned shared, cuda::Stream stream,
                void** arguments) const {
        const unsigned grid = static_cast<unsigned>(blocks);
        driver.check(driver.launch(function, grid, 1, 1, threads, 1, 1, shared, stream, arguments, nullptr), "a launch");
    }

    const cuda::Driver& driver;
    const unsigned processors;
    cuda::Function rows_function = nullptr, groups_function = nullptr;
    std::unique_ptr<cuda::Memory<float>> parameters;
    std::unique_ptr<cuda::Memory<std::uint32_t>> packed;
};

// To and from the elements of rows.
inline void element_of(float value, float& element) { element = value; }
inline float value_of(float element) { return element; }
inline void element_of(float value, std::uint16_t& element) {  // the nearest float16, ties to even
    std::uint32_t bits;
    std::memcpy(&bits, &value, 4);
    const std::uint32_t sign = bits >> 16 & 0x8000u, size = bits & 0x7fffffffu;
    std::uint32_t half = 0x7c00u;
    if (size > 0x7f800000u) half = 0x7e00u;
    else if (size < 0x38800000u) {  // whole multiples of 2^-24, which 0.5 has as its last digits
        float small;
        std::memcpy(&small, &size, 4);
        small += 0.5f;
        std::memcpy(&half, &small, 4);
        half -= 0x3f000000u;
    } else if (size < 0x477ff000u) half = (size + 0xfffu + (size >> 13 & 1u) - 0x38000000u) >> 13;
    element = static_cast<std::uint16_t>(sign | half);
}
inline float value_of(std::uint16_t element) {
    const std::uint32_t sign = (element & 0x8000u) << 16, size = element & 0x7fffu;
    std::uint32_t bits = size < 0x400u ? 0u : size < 0x7c00u ? (size << 13) + 0x38000000u : (size << 13) + 0x70000000u;
    float value;
    if (size < 0x400u) {
        const float small = static_cast<float>(size) / 16777216.0f;
        std::memcpy(&bits, &small, 4);
    }
    bits |= sign;
    std::memcpy(&value, &bits, 4);
    return value;
}

}  // namespace NAME

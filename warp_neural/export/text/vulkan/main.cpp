// Evaluates the rows of inputs.bin by Vulkan, with cooperative vectors where the device and the folder have them, and
// compares with outputs.bin, which Python made. Exit code 1: results differ; 2: refused; 77: no Vulkan here.
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "cooperative.hpp"
#include "device.hpp"
#include "network.hpp"
#include "pipeline.hpp"

static const char usage[] =
    "arguments: [FOLDER] [--device N] [--plain] [--rows N] [--results FILE] [--image FILE]\n"
    "FOLDER: exported, here by default; --plain: without cooperative vectors\n"
    "--rows: to time, 65536 by default: those of inputs.bin, again and again\n"
    "--results: of these, float32; --image: PPM, of a network of (u, v) to linear colours, NAME.ppm by default\n";
constexpr bool PICTURE = network::inputs == 2 && network::outputs == 3;

struct Options {
    std::string folder = ".", results, image;
    bool plain = false;
    long device = -1, rows = 65536;
};

static long whole(const std::string& option, const char* text, long least) {
    char* end = nullptr;
    const long value = std::strtol(text, &end, 10);
    if (*text == 0 || *end != 0 || value < least || value > (1L << 30))
        throw Failure(REFUSED, option + " " + text + ": give a whole number from " + std::to_string(least) + " on");
    return value;
}

static Options parsed(int count, char** arguments) {
    Options options;
    bool folder = false;
    for (int i = 1; i < count; ++i) {
        const std::string name = arguments[i];
        if (name == "--plain") {
            options.plain = true;
        } else if (name == "--device" || name == "--rows" || name == "--results" || name == "--image") {
            if (++i == count) throw Failure(REFUSED, name + ": its value is missing");
            if (name == "--device") options.device = whole(name, arguments[i], 0);
            if (name == "--rows") options.rows = whole(name, arguments[i], 1);
            if (name == "--results") options.results = arguments[i];
            if (name == "--image") options.image = arguments[i];
        } else if (folder || name[0] == '-') {
            throw Failure(REFUSED, name + ": unknown\n" + usage);
        } else {
            options.folder = name;
            folder = true;
        }
    }
    if (!options.image.empty() && !PICTURE)
        throw Failure(REFUSED, "--image: for networks of 2 inputs and 3 results alone");
    if (PICTURE && options.image.empty()) options.image = "NAME.ppm";
    return options;
}

static std::vector<char> read(const std::string& path) {
    std::FILE* file = std::fopen(path.c_str(), "rb");
    if (!file) throw Failure(REFUSED, path + ": cannot be read; give the exported folder");
    std::vector<char> bytes;
    char part[65536];
    for (size_t n; (n = std::fread(part, 1, sizeof(part), file)) > 0;) bytes.insert(bytes.end(), part, part + n);
    std::fclose(file);
    return bytes;
}

static std::vector<float> floats(const std::string& path) {
    const std::vector<char> bytes = read(path);
    std::vector<float> values(bytes.size() / sizeof(float));
    std::memcpy(values.data(), bytes.data(), values.size() * sizeof(float));
    return values;
}

static void write(const std::string& path, const std::string& head, const void* data, size_t size) {
    std::FILE* file = std::fopen(path.c_str(), "wb");
    const bool whole = file && std::fwrite(head.data(), 1, head.size(), file) == head.size() &&
                       std::fwrite(data, 1, size, file) == size;
    if ((file && std::fclose(file) != 0) || !whole) throw Failure(REFUSED, path + ": cannot be written");
}

// A file of this network: of its size, and with its sum (CRC-32, as zlib has it).
static std::vector<char> read(const std::string& folder, const network::File& file) {
    const std::vector<char> bytes = read(folder + "/" + file.name);
    uint32_t sum = ~0u;
    for (const char byte : bytes) {
        sum ^= static_cast<unsigned char>(byte);
        for (int bit = 0; bit < 8; ++bit) sum = sum >> 1 ^ (sum & 1 ? 0xedb88320u : 0u);
    }
    if (bytes.size() != file.size || ~sum != file.sum)
        throw Failure(REFUSED, folder + "/" + file.name + ": not that of network " + network::hash + ", " +
                                   std::to_string(bytes.size()) + " bytes of " + std::to_string(file.size) +
                                   "; export it again");
    return bytes;
}

static std::vector<char> module(const std::string& path) {
    std::vector<char> code = read(path);
    const unsigned char magic[] = {0x03, 0x02, 0x23, 0x07};
    if (code.size() < 20 || code.size() % 4 || std::memcmp(code.data(), magic, 4))
        throw Failure(REFUSED, path + ": not SPIR-V; export it again");
    return code;
}

// The network on one device.
struct Network {
    Device on;
    bool cooperative;
    std::vector<char> code;
    Buffer weights, matrices;
    std::vector<uint32_t> offsets;

    Network(const Options& options, VkPhysicalDevice physical, Cooperation& has, bool cooperative)
        : on(physical, cooperative ? has.chain() : nullptr,
             cooperative ? has.extensions() : std::vector<const char*>(), cooperative),
          cooperative(cooperative),
          code(module(options.folder + (cooperative ? "/NAME_cooperative.spv" : "/NAME.spv"))) {
        const std::vector<char> floats = read(options.folder, network::weights);
        weights = on.uploaded(floats.data(), floats.size());
        if (!cooperative) return;
        const Matrices converted(on, read(options.folder, network::matrices));
        matrices = converted.buffer;
        offsets = converted.offsets;
    }

    size_t most_rows() const {
        const VkPhysicalDeviceLimits& limits = on.properties.limits;
        return std::min(size_t(limits.maxComputeWorkGroupCount[0]) * network::group,
                        limits.maxStorageBufferRange / sizeof(float) / std::max(network::inputs, network::outputs));
    }

    // Results of rows, and sorted milliseconds of runs.
    std::vector<float> evaluate(const std::vector<float>& x, std::vector<double>& times) const {
        const size_t rows = x.size() / network::inputs, groups = (rows + network::group - 1) / network::group;
        std::vector<float> y(rows * network::outputs);
        const Buffer from = on.uploaded(x.data(), x.size() * sizeof(float));
        const Buffer to = on.buffer(y.size() * sizeof(float), false);
        std::vector<Buffer> buffers = {weights, from, to};
        if (cooperative) buffers.push_back(matrices);
        times = Pipeline(on, code, offsets, buffers).run(static_cast<uint32_t>(groups));
        on.download(to, y.data());
        return y;
    }
};

// Prints all devices; one with cooperative vectors if none is asked for, else the first.
static size_t chosen(const Options& options, const std::vector<VkPhysicalDevice>& all,
                     const std::vector<Cooperation>& has) {
    size_t best = 0;
    for (size_t i = all.size(); i-- > 0;)
        if (has[i].lacks().empty()) best = i;
    for (size_t i = 0; i < all.size(); ++i) {
        VkPhysicalDeviceProperties2 about = {};
        about.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2;
        vkGetPhysicalDeviceProperties2(all[i], &about);
        const uint32_t version = about.properties.apiVersion;
        std::printf("device %zu: %s, Vulkan %u.%u.%u, %s\n", i, about.properties.deviceName,
                    VK_API_VERSION_MAJOR(version), VK_API_VERSION_MINOR(version), VK_API_VERSION_PATCH(version),
                    has[i].says().c_str());
    }
    if (options.device >= static_cast<long>(all.size()))
        throw Failure(REFUSED, "--device " + std::to_string(options.device) + ": there are " +
                                   std::to_string(all.size()) + ", from 0 on");
    return options.device < 0 ? best : static_cast<size_t>(options.device);
}

// Of the largest expected value: how far results are off at most.
static double off(const std::vector<float>& found, const std::vector<float>& expected) {
    double largest = 0.0, difference = 0.0;
    for (const float value : expected)
        if (std::isfinite(value)) largest = std::max(largest, std::fabs(double(value)));
    for (size_t i = 0; i < found.size(); ++i) {
        const double a = found[i], b = expected[i % expected.size()];
        if (a == b || (std::isnan(a) && std::isnan(b))) continue;
        const double d = std::fabs(a - b);
        difference = d <= difference ? difference : std::isnan(d) ? HUGE_VAL : d;
    }
    return difference == 0.0 ? 0.0 : difference / largest;
}

// 256 x 256 pixels, sRGB.
static void save_image(const std::string& path, const Network& network) {
    const int side = 256;
    std::vector<float> x;
    for (int i = 0; i < side * side; ++i) {
        x.push_back((float(i % side) + 0.5f) / side);
        x.push_back((float(i / side) + 0.5f) / side);
    }
    std::vector<double> times;
    std::vector<unsigned char> codes;
    for (const float linear : network.evaluate(x, times)) {
        const float v = std::fmin(std::fmax(linear, 0.0f), 1.0f);
        const float code = v <= 0.0031308f ? 12.92f * v : 1.055f * std::pow(v, 1.0f / 2.4f) - 0.055f;
        codes.push_back(static_cast<unsigned char>(255.0f * code + 0.5f));
    }
    write(path, "P6\n256 256\n255\n", codes.data(), codes.size());
    std::printf("%s: a picture\n", path.c_str());
}

static int compare(const Options& options) {
    VkInstance instance = VK_NULL_HANDLE;
    const std::vector<VkPhysicalDevice> all = devices(instance);
    std::vector<Cooperation> has;
    for (const VkPhysicalDevice each : all) has.emplace_back(instance, each);
    const size_t at = chosen(options, all, has);
    const bool cooperative = network::cooperative && !options.plain && has[at].lacks().empty();
    const std::vector<float> given = floats(options.folder + "/inputs.bin");
    const std::vector<float> expected = floats(options.folder + "/outputs.bin");
    const size_t there = given.size() / network::inputs;
    if (there == 0 || given.size() % network::inputs || expected.size() != there * network::outputs)
        throw Failure(REFUSED, options.folder + ": inputs.bin and outputs.bin do not match; export it again");
    const Network network(options, all[at], has[at], cooperative);
    const size_t rows = std::max(size_t(options.rows), there), most = network.most_rows();
    if (rows > most)
        throw Failure(REFUSED, "--rows " + std::to_string(rows) + ": this device takes " + std::to_string(most) +
                                   " at most");
    std::vector<float> x(rows * network::inputs);
    for (size_t i = 0; i < x.size(); ++i) x[i] = given[i % given.size()];
    std::vector<double> times;
    const std::vector<float> y = network.evaluate(x, times);
    const double difference = off(y, expected);
    const double allowed = cooperative ? network::cooperative_tolerance : network::tolerance;
    std::printf("device %zu, %s: %zu rows, off by %.2g of the largest result at most, allowed is %g\n", at,
                cooperative ? "cooperative vectors" : "plain", rows, difference, allowed);
    const double median = times[times.size() / 2];
    if (median > 0.0)
        std::printf("%.4f ms, the median of %zu runs: %.4g million rows a second\n", median, times.size(),
                    1e-3 * double(rows) / median);
    else
        std::printf("no time: this device has no timestamps\n");
    if (!options.results.empty()) write(options.results, "", y.data(), there * network::outputs * sizeof(float));
    if (!options.image.empty()) save_image(options.image, network);
    return difference <= allowed ? 0 : DIFFERENT;
}

int main(int count, char** arguments) {
    try {
        return compare(parsed(count, arguments));
    } catch (const Failure& failure) {
        std::fprintf(stderr, "%s\n", failure.what());
        return failure.code;
    }
}

// Evaluates the rows of inputs.bin on a CUDA device, compares them with those of outputs.bin, which Python made on a
// CPU, and times more of them; where x is (u, v) and y a linear colour, it also writes picture.ppm.
//
//     NAME_test [FOLDER] [--device N] [--results FILE]
//
// FOLDER: that of weights.bin and the kernels, here by default. Exit codes: 0, 1 different results, 2 broken files or
// arguments, 77 no device that the kernels run on.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>

#include "NAME.hpp"

using Elements = std::vector<NAME::Element>;

static std::vector<float> read_rows(const std::string& path, size_t width) {
    const std::vector<char> bytes = NAME::detail::read(path);
    std::vector<float> values(bytes.size() / 4);
    if (values.empty() || bytes.size() % (4 * width)) throw std::invalid_argument(path + ": no whole rows");
    std::memcpy(values.data(), bytes.data(), bytes.size());
    return values;
}

static void write_file(const std::string& path, const std::string& start, const void* data, size_t size) {
    std::ofstream file(path, std::ios::binary);
    file.write(start.data(), start.size());
    file.write(static_cast<const char*>(data), size);
    if (!file.flush()) throw std::invalid_argument(path + ": cannot be written");
}

static std::vector<float> evaluate(const cuda::Driver& driver, const NAME::Network& network, const std::vector<float>& x) {
    const size_t rows = x.size() / NAME::inputs;
    Elements from(x.size()), to(rows * NAME::outputs);
    for (size_t i = 0; i < x.size(); ++i) NAME::element_of(x[i], from[i]);
    const cuda::Memory<NAME::Element> inputs(driver, from.data(), from.size()), outputs(driver, to.size());
    network.evaluate(inputs.pointer, outputs.pointer, static_cast<int>(rows));
    driver.check(driver.synchronize(), "the network");
    outputs.download(to.data());
    std::vector<float> y(to.size());
    for (size_t i = 0; i < y.size(); ++i) y[i] = NAME::value_of(to[i]);
    return y;
}

// Milliseconds, the median of 30 launches.
static float time_rows(const cuda::Driver& driver, const NAME::Network& network, int rows) {
    std::mt19937 random(0);
    std::uniform_real_distribution<float> uniform(-1.0f, 1.0f);
    Elements from(static_cast<size_t>(rows) * NAME::inputs);
    for (NAME::Element& each : from) NAME::element_of(uniform(random), each);
    const cuda::Memory<NAME::Element> x(driver, from.data(), from.size());
    const cuda::Memory<NAME::Element> y(driver, static_cast<size_t>(rows) * NAME::outputs);
    cuda::Event begin, end;
    driver.check(driver.event_create(&begin, 0), "an event");
    driver.check(driver.event_create(&end, 0), "an event");
    std::vector<float> times(30);
    for (int i = -10; i < static_cast<int>(times.size()); ++i) {  // ten to warm up
        driver.check(driver.event_record(begin, nullptr), "an event");
        network.evaluate(x.pointer, y.pointer, rows);
        driver.check(driver.event_record(end, nullptr), "an event");
        driver.check(driver.synchronize(), "the network");
        if (i >= 0) driver.check(driver.event_time(&times[i], begin, end), "an event");
    }
    std::nth_element(times.begin(), times.begin() + times.size() / 2, times.end());
    return times[times.size() / 2];
}

static void write_picture(const cuda::Driver& driver, const NAME::Network& network, const std::string& path) {
    const int side = 512;
    std::vector<float> uv;
    for (int i = 0; i < side * side; ++i) uv.insert(uv.end(), {(i % side + 0.5f) / side, (i / side + 0.5f) / side});
    std::vector<unsigned char> codes;
    for (float linear : evaluate(driver, network, uv)) {
        linear = std::min(std::max(linear, 0.0f), 1.0f);
        const float srgb = linear <= 0.0031308f ? 12.92f * linear : 1.055f * std::pow(linear, 1 / 2.4f) - 0.055f;
        codes.push_back(static_cast<unsigned char>(std::lround(255 * srgb)));
    }
    write_file(path, "P6 " + std::to_string(side) + " " + std::to_string(side) + " 255\n", codes.data(), codes.size());
    std::printf("%s: x as (u, v), y as a linear colour\n", path.c_str());
}

static int run(const std::string& folder, int device, const std::string& results) {
    const std::vector<float> inputs = read_rows(folder + "/inputs.bin", NAME::inputs);
    const std::vector<float> expected = read_rows(folder + "/outputs.bin", NAME::outputs);
    if (inputs.size() / NAME::inputs != expected.size() / NAME::outputs)
        throw std::invalid_argument(folder + ": inputs.bin and outputs.bin have different numbers of rows");
    NAME::detail::read_weights(folder + "/weights.bin");  // before a driver is asked for
    const cuda::Driver driver;
    int count = 0;
    driver.check(driver.device_count(&count), "the devices");
    if (device < 0 || device >= count)
        throw cuda::Unavailable("no CUDA device " + std::to_string(device) + "; there are " + std::to_string(count));
    char name[256];
    driver.check(driver.device_name(name, sizeof(name), device), "the device's name");
    const NAME::Network network(driver, folder, device);
    const int arch = driver.arch(device);
    std::printf("%s, compute capability %d.%d, %s%s\n", name, arch / 10, arch % 10, NAME::precision,
                network.by_warpgroups() ? ", by warpgroups" : "");

    const std::vector<float> y = evaluate(driver, network, inputs);
    double off = 0, whole = 0;
    for (size_t i = 0; i < y.size(); ++i) {
        off += std::pow(y[i] - expected[i], 2.0);
        whole += std::pow(expected[i], 2.0);
    }
    const double error = std::sqrt(off / std::max(whole, 1e-30));
    std::printf("%zu rows: RMS difference %.2g of the results, %.2g allowed\n", y.size() / NAME::outputs, error,
                NAME::tolerance);
    if (!results.empty()) write_file(results, "", y.data(), y.size() * sizeof(float));
    const int rows = 1 << 20;
    const double milliseconds = time_rows(driver, network, rows);
    std::printf("%d rows: %.4f ms, %.1f TFLOP/s\n", rows, milliseconds, NAME::flops * rows / milliseconds * 1e-9);
    if (NAME::inputs == 2 && NAME::outputs == 3) write_picture(driver, network, folder + "/picture.ppm");
    return error <= NAME::tolerance ? 0 : 1;  // so is NaN
}

static int number_of(const std::string& text) {
    if (text.empty() || text.size() > 4 || text.find_first_not_of("0123456789") != std::string::npos)
        throw std::invalid_argument("--device " + text + ": give its number, from 0 on");
    return std::atoi(text.c_str());
}

int main(int count, char** arguments) try {
    std::string folder = ".", results;
    int device = 0;
    for (int i = 1; i < count; ++i) {
        const std::string each = arguments[i];
        if (each == "--device" && i + 1 < count) device = number_of(arguments[++i]);
        else if (each == "--results" && i + 1 < count) results = arguments[++i];
        else if (each[0] != '-') folder = each;
        else throw std::invalid_argument(each + ": unknown; the arguments are [FOLDER] [--device N] [--results FILE]");
    }
    return run(folder, device, results);
} catch (const cuda::Unavailable& problem) {
    std::fprintf(stderr, "%s\n", problem.what());
    return 77;
} catch (const std::exception& problem) {
    std::fprintf(stderr, "%s\n", problem.what());
    return 2;
}

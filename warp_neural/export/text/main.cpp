// Evaluates the rows of inputs.bin and compares them with those of outputs.bin, which Python made. Arguments: the folder
// of these, here by default, and a file to write the results to, if wanted.
#include <cmath>
#include <cstdio>
#include <cstring>
#include <string>
#include <vector>

#include "NAME.hpp"

static std::vector<float> read(const std::string& path) {
    std::vector<float> values;
    std::FILE* file = std::fopen(path.c_str(), "rb");
    if (!file) {
        std::fprintf(stderr, "%s: cannot be read; give the exported folder\n", path.c_str());
        return values;
    }
    for (float value; std::fread(&value, sizeof(value), 1, file) == 1;) values.push_back(value);
    std::fclose(file);
    return values;
}

int main(int count, char** arguments) {
    const std::string folder = count > 1 ? arguments[1] : ".";
    const std::vector<float> inputs = read(folder + "/inputs.bin"), expected = read(folder + "/outputs.bin");
    const size_t rows = inputs.size() / NAME::inputs;
    if (rows == 0 || expected.size() != rows * NAME::outputs) return 2;
    std::FILE* results = count > 2 ? std::fopen(arguments[2], "wb") : nullptr;
    size_t different = 0;
    float largest = 0.0f;
    for (size_t row = 0; row < rows; ++row) {
        float x[NAME::inputs], y[NAME::outputs];
        std::memcpy(x, &inputs[row * NAME::inputs], sizeof(x));
        NAME::evaluate(x, y);
        if (results) std::fwrite(y, sizeof(y), 1, results);
        for (int i = 0; i < NAME::outputs; ++i) {
            const float difference = std::fabs(y[i] - expected[row * NAME::outputs + i]);
            different += difference != 0.0f;
            largest = difference > largest ? difference : largest;
        }
    }
    if (results) std::fclose(results);
    std::printf("%zu rows, %zu results differ from Python's, by %g at most\n", rows, different, largest);
    return different != 0;
}

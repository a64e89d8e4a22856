// Reads RTXNS's binary network by its documented layout and prints sizes, then each layer's weights [n_out, n_in] and
// biases as the bits of float32. Exit code 1 where the file contradicts the layout.
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

struct Layer {
    uint32_t inputs, outputs;
    uint64_t weight_bytes, bias_bytes;
    uint32_t weight_offset, bias_offset;
};

struct Header {
    uint32_t version, hidden_layers, inputs, hidden_neurons, outputs;
    int32_t weight_precision, bias_precision;
    Layer layers[8];
    int32_t layout;
    uint64_t data_bytes;
};

static_assert(sizeof(Header) == 304 && offsetof(Header, layers) == 32 && offsetof(Header, data_bytes) == 296, "");

static void require(bool condition, const char* what) {
    if (!condition) {
        std::fprintf(stderr, "%s\n", what);
        std::exit(1);
    }
}

static float half_to_float(uint16_t half) {
    const int exponent = half >> 10 & 31;
    require(exponent < 31, "not finite");
    float value = exponent ? 1.0f + (half & 1023) / 1024.0f : (half & 1023) / 1024.0f;
    for (int e = exponent ? exponent : 1; e < 15; ++e) value *= 0.5f;
    for (int e = 15; e < exponent; ++e) value *= 2.0f;
    return half >> 15 ? -value : value;
}

static uint32_t element(const unsigned char* data, int precision, uint64_t index) {
    uint32_t bits;
    if (precision) {
        std::memcpy(&bits, data + 4 * index, 4);
        return bits;
    }
    uint16_t half;
    std::memcpy(&half, data + 2 * index, 2);
    const float value = half_to_float(half);
    std::memcpy(&bits, &value, 4);
    return bits;
}

int main(int, char** arguments) {
    std::FILE* file = std::fopen(arguments[1], "rb");
    Header header;
    require(file && std::fread(&header, sizeof header, 1, file) == 1, "no header");
    require(header.version == 0xA1C0DE01u, "version");
    require(header.hidden_layers < 8, "hidden layers");
    require((header.weight_precision | header.bias_precision) >> 1 == 0, "precision");
    require(header.layout == 0 || header.layout == 1, "layout");
    std::vector<unsigned char> data(header.data_bytes);
    require(std::fread(data.data(), 1, data.size(), file) == data.size() && std::fgetc(file) == EOF, "data bytes");
    std::printf("%u\n", header.hidden_layers + 1);
    for (uint32_t index = 0; index < 8; ++index) {
        const Layer layer = header.layers[index];
        if (index > header.hidden_layers) {
            const Layer none = {};
            require(!std::memcmp(&layer, &none, sizeof none), "unused layer");
            continue;
        }
        require(layer.inputs == (index ? header.hidden_neurons : header.inputs), "inputs");
        require(layer.outputs == (index < header.hidden_layers ? header.hidden_neurons : header.outputs), "outputs");
        const uint64_t k = layer.inputs, n = layer.outputs;
        require(layer.weight_bytes == k * n * (header.weight_precision ? 4 : 2), "weight bytes");
        require(layer.bias_bytes == n * (header.bias_precision ? 4 : 2), "bias bytes");
        require((layer.weight_offset | layer.bias_offset) % 64 == 0, "alignment");
        require(layer.weight_offset + layer.weight_bytes <= layer.bias_offset, "overlap");
        require(layer.bias_offset + layer.bias_bytes <= header.data_bytes, "bounds");
        std::printf("%u %u\n", layer.inputs, layer.outputs);
        for (uint64_t i = 0; i < n; ++i)
            for (uint64_t j = 0; j < k; ++j)
                std::printf("%u ", element(&data[layer.weight_offset], header.weight_precision,
                                           header.layout ? j * n + i : i * k + j));
        for (uint64_t i = 0; i < n; ++i)
            std::printf("%u ", element(&data[layer.bias_offset], header.bias_precision, i));
        std::printf("\n");
    }
}

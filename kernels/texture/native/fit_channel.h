// The weights of one channel's context, trained with Adam on samples of cells, and those dropped that save less than
// they cost. warp_neural/texture/fit.py says what is trained. For CPUs.
// Constants: LANES of a vector, VECTORS side by side, LEAST of a probability, WEIGHT_BITS of a weight in the file, MOST
// weights.
// Names: samples, [n own, n of each of 6 neighbours, sums of four parents; cells], cells whole vectors side by side;
// values, [14 + 2 n + parents, n] as in a context, of scales as logarithms: weights in the end; channel; steps; batch,
// cells of a step; stands_for, cells of the texture for each that is sampled.

typedef float Lanes __attribute__((vector_size(4 * LANES), aligned(4)));
typedef int Whole __attribute__((vector_size(4 * LANES), aligned(4)));
typedef short Sample __attribute__((vector_size(2 * LANES), aligned(2)));
const auto exponential = [](Lanes x) -> Lanes {  // of 0 down to -80, below as of -80
    x = __builtin_elementwise_max(x, Lanes{} - 80.0f) * 1.44269504f;
    const Whole whole = __builtin_convertvector(x - 0.5f, Whole);
    const Lanes part = x - __builtin_convertvector(whole, Lanes);
    const Lanes high = 0.05550411f + part * (0.00961813f + part * 0.00133336f);
    return (1.0f + part * (0.69314718f + part * (0.24022651f + part * high))) * (Lanes)((whole + 127) << 23);
};
const int n = (int)values.shape[1], parents = (int)values.shape[0] - 14 - 2 * n;
const int cells = (int)samples.shape[1], pairs = 6 + channel, features = pairs + parents;
// Weights: of the scale, a constant and of each feature (six neighbours, channels before, parents); of the mean, a
// constant and of each feature but parents.
const int mean_0 = 1 + features, count = mean_0 + 1 + pairs;
const Sample* sample[MOST];
int row[MOST];  // in values
row[0] = 0;
row[mean_0] = 1;
for (int f = 0; f < features; ++f) {
    const int which = f < 6 ? n + f * n + channel : f < pairs ? f - 6 : 7 * n + f - pairs;
    sample[f] = (const Sample*)(samples.data + (long long)which * cells);
    row[1 + f] = f < 6 ? 2 + f : f < pairs ? 8 + f : 14 + 2 * n + f - pairs;
    if (f < pairs) row[mean_0 + 1 + f] = f < 6 ? 8 + f : 8 + n + f;
}
const Sample* const own = (const Sample*)(samples.data + (long long)channel * cells);
float value[MOST], weight[MOST], kept[MOST], first[MOST] = {}, second[MOST] = {};
for (int i = 0; i < count; ++i) {
    value[i] = values.data[row[i] * n + channel];
    kept[i] = 1.0f;
}

Lanes sums[MOST];
// To sums, of each weight: of cells from one to another, its derivatives of the bits, or their squares.
const auto sum = [&](int from, int to, bool squares) {
    for (int i = 0; i < count; ++i) sums[i] = Lanes{};
    for (int i = from / LANES; i < to / LANES; i += VECTORS) {
        Lanes in_scale[VECTORS], in_mean[VECTORS];
        for (int j = 0; j < VECTORS; ++j) {
            in_scale[j] = Lanes{} + weight[0];
            in_mean[j] = Lanes{} + weight[mean_0];
        }
        for (int f = 0; f < pairs; ++f)
            for (int j = 0; j < VECTORS; ++j) {
                const Lanes x = __builtin_convertvector(sample[f][i + j], Lanes);
                in_scale[j] += weight[1 + f] * __builtin_elementwise_abs(x);
                in_mean[j] += weight[mean_0 + 1 + f] * x;
            }
        for (int f = pairs; f < features; ++f)
            for (int j = 0; j < VECTORS; ++j)
                in_scale[j] += weight[1 + f] * __builtin_convertvector(sample[f][i + j], Lanes);
        for (int j = 0; j < VECTORS; ++j) {  // of a Laplace distribution's mass half a step around the latent
            const Lanes inverse = 1.0f / __builtin_elementwise_max(in_scale[j], Lanes{} + 1.0f / 64);
            const Lanes away = __builtin_convertvector(own[i + j], Lanes) - in_mean[j];
            const Lanes near = __builtin_elementwise_abs(away) - 0.5f, far = near + 1.0f;
            const Lanes inner = exponential(-__builtin_elementwise_abs(near) * inverse);
            const Lanes outer = exponential(-far * inverse);
            const Lanes mass = 0.5f * (near > 0.0f ? inner - outer : 2.0f - inner - outer);
            const Lanes factor = -0.72134752f / __builtin_elementwise_max(mass, Lanes{} + LEAST) * inverse;
            in_scale[j] = factor * (inner * near - outer * far) * inverse;
            in_mean[j] = factor * (away < 0.0f ? outer - inner : inner - outer);
            if (squares) in_scale[j] *= in_scale[j], in_mean[j] *= in_mean[j];
            sums[0] += in_scale[j];
            sums[mean_0] += in_mean[j];
        }
        for (int f = 0; f < features; ++f) {
            Lanes of_scale = {}, of_mean = {};
            for (int j = 0; j < VECTORS; ++j) {
                Lanes x = __builtin_convertvector(sample[f][i + j], Lanes);
                if (squares) x *= x;
                of_scale += in_scale[j] * __builtin_elementwise_abs(x);
                of_mean += in_mean[j] * x;
            }
            sums[1 + f] += of_scale;
            if (f < pairs) sums[mean_0 + 1 + f] += of_mean;
        }
    }
};
const auto total = [&](int i) {
    float result = 0.0f;
    for (int l = 0; l < LANES; ++l) result += sums[i][l];
    return result;
};
const auto set_weights = [&] {
    for (int i = 0; i < count; ++i) weight[i] = (i < mean_0 ? expf(value[i]) : value[i]) * kept[i];
};
for (int step = 0; step < steps; ++step) {
    set_weights();
    if (step == steps / 2) {  // half the square of a weight times the curvature, in nats: what it saves
        sum(0, cells, true);
        for (int i = 1; i < count; ++i)
            if (weight[i] * weight[i] * total(i) * stands_for * 0.34657359f <= WEIGHT_BITS) weight[i] = kept[i] = 0.0f;
    }
    const int batches = cells / batch, from = batches ? step % batches * batch : 0, size = batches ? batch : cells;
    sum(from, from + size, false);
    const float rate = 0.06f * (1.0f - (float)step / steps) + 0.003f;
    for (int i = 0; i < count; ++i) {
        const float gradient = total(i) / size * (i < mean_0 ? weight[i] : kept[i]);
        first[i] += 0.1f * (gradient - first[i]);
        second[i] += 0.01f * (gradient * gradient - second[i]);
        const float root = sqrtf(second[i] / (1.0f - powf(0.99f, step + 1.0f))) + 1e-9f;
        value[i] -= rate * (i < mean_0 ? 1.0f : 0.2f) * first[i] / (1.0f - powf(0.9f, step + 1.0f)) / root;
    }
}
set_weights();
for (int r = 0; r < (int)values.shape[0]; ++r) values.data[r * n + channel] = 0.0f;
for (int i = 0; i < count; ++i) values.data[row[i] * n + channel] = weight[i];

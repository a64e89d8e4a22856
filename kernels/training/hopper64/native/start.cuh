// `v`, the last layer's dz of each thread's own sample, to shared memory and to TILES operands of this warp; its sum
// over the warp to register BIAS_SUMS: lane i has half of that of neuron i / 2.
// Constants besides: LAST_DZ in an area, LAST_ROW bytes of a row there. Names: places.cuh, products.cuh, pack.

const unsigned last = area + LAST_DZ;
if (lane < 16 * TILES) {
    const unsigned swizzle = lane >> 2 & 1u, mine = last + own * LAST_ROW;
    save_unit(mine + (swizzle << 4), pack(v[0], v[1]), pack(v[2], v[3]), pack(v[4], v[5]), pack(v[6], v[7]));
    save_unit(mine + ((1u ^ swizzle) << 4), pack(v[8], v[9]), pack(v[10], v[11]), pack(v[12], v[13]),
              pack(v[14], v[15]));
}
__syncwarp();
#pragma unroll
for (int m = 0; m < TILES; ++m)
    load(last + (m * 64 + row) * LAST_ROW + ((upper ^ (lane >> 2 & 1u)) << 4), dz[m][0]);
publish();
// lanes halve the neurons that each has, and exchange the others
auto halve = [&](int count) {
#pragma unroll
    for (int i = 0; i < count; ++i) {
        const bool high = lane & (2 * count);
        const real kept = high ? v[i + count] : v[i], sent = high ? v[i] : v[i + count];
        v[i] = kept + __shfl_xor_sync(0xffffffffu, sent, 2 * count);
    }
};
halve(8);
halve(4);
halve(2);
halve(1);
sum.c[BIAS_SUMS] += v[0];

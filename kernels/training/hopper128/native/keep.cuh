// This warp's rows of a slot, in so many panels, to byte `to` of the tile in memory, KEPT bytes long; under way.
// Constants besides: ROW, PANEL. Names: places.cuh, products.cuh, kept, start.

auto keep = [&](unsigned slot, int panels, unsigned to) {
    const size_t tile = start / 64 + blockIdx.x * 2 + group;
    char* const memory_of = reinterpret_cast<char*>(kept.data) + tile * KEPT + to + first * ROW;
    publish();
    __syncwarp();
    if (lane == 0) {
        const unsigned from = area + slot + first * ROW;
#pragma unroll
        for (int p = 0; p < panels; ++p)
            asm volatile("cp.async.bulk.global.shared::cta.bulk_group [%0],[%1],%2;" ::"l"(memory_of + p * PANEL),
                         "r"(from + p * PANEL), "n"(16 * ROW)
                         : "memory");
        asm volatile("cp.async.bulk.commit_group;" ::: "memory");
    }
    __syncwarp();
};

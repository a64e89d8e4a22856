// From memory to bytes `begin` to `end` of an area, under way; of the round `start`, if `inside`. Constants: KEPT,
// bytes of a tile. Names: places.cuh, kept.

auto fetch = [&](int start, bool inside, unsigned begin, unsigned end) {
    const size_t tile = start / 64 + blockIdx.x * 2 + group;
    const char* const memory_of = reinterpret_cast<const char*>(kept.data) + tile * KEPT;
    if (inside)
        for (unsigned at = begin + (threadIdx.x & 127u) * 16; at < end; at += 128 * 16)
            asm volatile("cp.async.cg.shared.global [%0],[%1],16;" ::"r"(area + at), "l"(memory_of + at) : "memory");
    asm volatile("cp.async.commit_group;" ::: "memory");
};

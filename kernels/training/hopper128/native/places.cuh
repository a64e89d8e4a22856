// As hopper64/native/places.cuh, of slots in panels; `areas` of both warpgroups.
// Constants, in bytes: ONES, AREAS, AREA, ROW, PANEL. Names: lane, memory.

const unsigned warp = __shfl_sync(0xffffffffu, threadIdx.x >> 5, 0), group = warp >> 2;
const unsigned weights = (static_cast<unsigned>(__cvta_generic_to_shared(memory.data.ptr)) + 1023u) & ~1023u;
const unsigned ones = weights + ONES, areas = weights + AREAS, area = areas + group * AREA;
const unsigned first = (warp & 3u) * 16, upper = lane >> 4, row = first + (lane & 15u), own = row;
const unsigned place = row * ROW + ((upper ^ (lane & 7u)) << 4);
auto unit = [&](unsigned slot, int u) {
    return area + slot + u / 8 * PANEL + own * ROW + ((u % 8 ^ (lane & 7u)) << 4);
};
auto matrices = [&](unsigned slot, int b) { return area + slot + b / 4 * PANEL + (place ^ (b % 4 << 5)); };

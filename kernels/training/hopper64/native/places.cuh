// A block's shared memory, from its first multiple of 1024 bytes on, and this lane's places in its warpgroup's slots.
// Constants, in bytes: ONES, AREAS, AREA, ROW; SAMPLES of a warpgroup. Names: lane, memory.

const unsigned warp = __shfl_sync(0xffffffffu, threadIdx.x >> 5, 0), group = warp >> 2;
const unsigned weights = (static_cast<unsigned>(__cvta_generic_to_shared(memory.data.ptr)) + 1023u) & ~1023u;
const unsigned ones = weights + ONES, area = weights + AREAS + group * AREA;
const unsigned first = (warp & 3u) * 16, upper = lane >> 4;  // row of this warp in a tile; half of the warp
const unsigned own = upper * 64 + first + (lane & 15u), row = first + (lane & 15u);  // this lane's sample
const unsigned place = row * ROW + ((upper ^ (lane & 7u)) << 4);
auto unit = [&](unsigned slot, int u) { return area + slot + own * ROW + ((u ^ (lane & 7u)) << 4); };
auto matrices = [&](unsigned slot, int m, int b) { return area + slot + m * (64 * ROW) + (place ^ (b << 5)); };
auto together = [&]() { asm volatile("bar.sync %0, %1;" ::"r"(group + 1u), "n"(SAMPLES) : "memory"); };

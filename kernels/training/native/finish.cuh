// The end of a launch: `mine`, BLOCK_SUMS floats that the block leaves in memory; `total`, its shared memory.

using real = wp::float32;
const unsigned lane = threadIdx.x & 31u, g = lane >> 2, t = lane & 3u, warp = threadIdx.x >> 5;
real* const total = reinterpret_cast<real*>(memory.data.ptr);
real* const mine = partial.data + static_cast<size_t>(blockIdx.x) * BLOCK_SUMS;

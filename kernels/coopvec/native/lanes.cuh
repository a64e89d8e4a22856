// What all texts of whole warps see: lane = 4 g + t, as in PTX's tables of fragments.

using real = wp::float32;
using integer = wp::int32;
const unsigned lane = threadIdx.x & 31u, g = lane >> 2, t = lane & 3u;

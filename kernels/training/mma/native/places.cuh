// Where a warp's vectors and a block's weights lie in shared memory, as 8 x 8 matrices.
// Constants: WEIGHTS bytes of all weights, AREA of a warp's area. Names: lane, memory.

const unsigned warp = threadIdx.x >> 5;
const unsigned weights = static_cast<unsigned>(__cvta_generic_to_shared(memory.data.ptr)) + lane * 16;
const unsigned areas = weights + WEIGHTS, area = areas + warp * AREA;
const unsigned turned = (lane >> 4) * 128 + (lane >> 3 & 1u) * 256 + (lane & 7u) * 16;  // matrices 0, 2, 1, 3
// this lane's own row: unit u holds its columns 8 u .. 8 u + 7
auto own_unit = [&](unsigned slot, int blocks, int u) {
    const unsigned matrix = ((lane >> 4) * blocks + u / 2) * 4 + u % 2 * 2 + (lane >> 3 & 1u);
    return slot + matrix * 128 + (lane & 7u) * 16 - lane * 16;
};

// Rows in memory, `row` of `x` and those of the other lanes, which follow each other, to the A operand `a`, 16 bytes a
// lane. Constants: INPUT_UNITS of 16 bytes in a row. Names: lanes.cuh, staging.cuh, x, row, a.

const size_t pitch = x.strides[0];
const size_t start = __shfl_sync(0xffffffffu, reinterpret_cast<size_t>(x.data) + row * pitch, 0);
#pragma unroll
for (int c = 0; c < INPUT_UNITS; c += UNITS) {
    for (unsigned i = 0; i < UNITS; ++i) {
        const unsigned r = (32 * i + lane) / UNITS, u = lane % UNITS;
        if (c + u < INPUT_UNITS)
            asm volatile("cp.async.cg.shared.global [%0],[%1],16;" ::"r"(rows + (r * UNITS + (u ^ swizzled(r))) * 16),
                         "l"(start + r * pitch + 16 * (c + u))
                         : "memory");
    }
    asm volatile("cp.async.wait_all;" ::: "memory");
    __syncwarp();
#pragma unroll
    for (int b = c / 2; b < (c + UNITS) / 2 && b < INPUT_UNITS / 2; ++b)
#pragma unroll
        for (int m = 0; m < 2; ++m) gather(m, b, a[m][b]);
    __syncwarp();
}

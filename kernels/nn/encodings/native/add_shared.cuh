// `add`, `add2`, `add4` as in atomics.cuh, to a block's shared memory. Names: real.

auto add = [](real* a, real x) { atomicAdd(a, x); };
auto add2 = [](real* a, real x, real y) { atomicAdd(a, x); atomicAdd(a + 1, y); };
auto add4 = [](real* a, real x, real y, real z, real w) {
    atomicAdd(a, x); atomicAdd(a + 1, y); atomicAdd(a + 2, z); atomicAdd(a + 3, w);
};

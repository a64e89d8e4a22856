"""The shared memory through which the vectors of a block's warps pass: one pool a kernel, whatever calls share it.

Whoever takes the pool keeps to the part of its own warp, 32 rows of `CHUNK` 16-byte units, takes it with whole warps
only, and leaves it with a `__syncwarp()` after the last access, so that the next may write at once.
"""

import warp as wp

# Units of a row that pass at a time: all 8 of 64 halves where few threads share a multiprocessor's memory
CHUNK = "constexpr int CHUNK = WP_TILE_BLOCK_DIM <= 64 ? 8 : WP_TILE_BLOCK_DIM <= 128 ? 4 : 2;\n"
MEMORY = f"""#if defined(__CUDA_ARCH__)
{CHUNK}
__shared__ uint4 memory[WP_TILE_BLOCK_DIM * CHUNK];
return static_cast<unsigned>(__cvta_generic_to_shared(memory));
#else
return 0u;
#endif
"""
# `own_pool`: the calling warp's part, from the address `pool`
OWN_POOL = f"""{CHUNK}
uint4* const own_pool = static_cast<uint4*>(__cvta_shared_to_generic(pool)) + (threadIdx.x & ~31u) * CHUNK;
"""


@wp.func_native(MEMORY)
def pool() -> wp.uint32:
    """Shared address of the pool of the calling thread's block: 8 KB up to 256 threads, 32 bytes a thread above.

    0 on the CPU. Warp writes a function once into a module, however often it is called: that makes it one pool, where
    an array in each native function would be memory of its own each time. So every function that needs shared memory
    takes this address.
    """
    ...

// Of the groups of GROUP, 4, values at i, i + step, ...: on the CPU, the first that lies before `passed`, is not zero
// or lies at the end; on CUDA i itself, as the threads of a warp stay side by side.

#if !defined(__CUDA_ARCH__)
for (; i >= passed && i + GROUP <= values.shape[0]; i += step) {
    const wp::uint32* const bits = reinterpret_cast<const wp::uint32*>(values.data + i);
    if (((bits[0] | bits[1] | bits[2] | bits[3]) & 0x7fffffffu) != 0u) break;
}
#endif
return i;

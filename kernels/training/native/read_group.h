// `values[i : i + GROUP]`, zeros after the last. Loops are unrolled, or the group would lie in memory.

wp::vec_t<GROUP, wp::float32> group;
const wp::float32* const from = values.data + i;
#if defined(__CUDA_ARCH__)
if (i + GROUP <= values.shape[0]) {
    const float4 q = *reinterpret_cast<const float4*>(from);
    group.c[0] = q.x; group.c[1] = q.y; group.c[2] = q.z; group.c[3] = q.w;
    return group;
}
#endif
#pragma unroll
for (int c = 0; c < GROUP; ++c)
    if (i + c < values.shape[0]) group.c[c] = from[c];
return group;

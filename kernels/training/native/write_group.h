// The inverse of read_group.h, of `group`, GROUP floats.

wp::float32* const to = values.data + i;
#if defined(__CUDA_ARCH__)
if (i + GROUP <= values.shape[0]) {
    *reinterpret_cast<float4*>(to) = make_float4(group.c[0], group.c[1], group.c[2], group.c[3]);
    return;
}
#endif
#pragma unroll
for (int c = 0; c < GROUP; ++c)
    if (i + c < values.shape[0]) to[c] = group.c[c];

// The next symbol of a stream, `value`: an entry of `table`, nearest to `centre` first, first towards `phase`, or after
// its last entry RAW_BITS bits as they are. Constant: RAW_BITS. Names: start_decoding.h, and value. In CUDA a warp
// decodes one stream.

{
    unsigned slot = state & 0xffffu;
    int j = 1;  // the first entry that is not less than slot
#if defined(__CUDA_ARCH__)
    unsigned found;
    while (!(found = __ballot_sync(~0u, table[j + (threadIdx.x & 31)] >= slot))) j += 32;
    j += __ffs(found) - 1;
#else
    for (int less = 8; less == 8; j += less) {
        less = 0;
        for (int k = 0; k < 8; ++k) less += table[j + k] < slot;
    }
#endif
    const unsigned start = (table[j - 1] + 1u) & 0xffffu;
    state = (table[j] + 1u - start) * (state >> 16) + slot - start;
    while (state < 1u << 23) state = state << 8 | (at < end ? *at++ : (damaged = true, 255u));
    if (table[j] != 0xffffu) {
        const int from = j & 1 ? -(j >> 1) : j >> 1;
        value = centre + (phase < 0 ? -from : from);
    } else {
        slot = state & 0xffffu;
        value = (int)(slot >> (16 - RAW_BITS)) - (1 << (RAW_BITS - 1));
        state = (state >> 16 << (16 - RAW_BITS)) + (slot & ((1u << (16 - RAW_BITS)) - 1u));
        while (state < 1u << 23) state = state << 8 | (at < end ? *at++ : (damaged = true, 255u));
    }
}

// The row of the calling thread as 32-bit `words`; only together are they split, so that what packs them again costs
// nothing. Constants: N elements of SIZE bytes, UNITS of 16 bytes in the row, 0: not whole ones.
// Names: bytes, step from element to element, aligned, words, together, whether `words` are loaded.

if (!together) {
    if (UNITS > 0 && aligned) {
#pragma unroll
        for (int u = 0; u < UNITS; ++u) {
            const uint4 q = reinterpret_cast<const uint4*>(bytes)[u];
            words[4 * u] = q.x;
            words[4 * u + 1] = q.y;
            words[4 * u + 2] = q.z;
            words[4 * u + 3] = q.w;
        }
    } else {
#pragma unroll
        for (int i = 0; i < N; ++i) {
            if (SIZE == 2)
                words[i / 2] |= *reinterpret_cast<const unsigned short*>(bytes + i * step) << i % 2 * 16;
            else
                words[i] = *reinterpret_cast<const unsigned*>(bytes + i * step);
        }
    }
}

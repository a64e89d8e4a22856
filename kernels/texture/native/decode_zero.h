// Most latents are 0, most often the nearest symbol: on to the next channel if this one is. Names: each_latent.h,
// start_decoding.h.

{
    const int last_of_zero = looked_up(zeros, which, of_zero, c);
    const unsigned slot = state & 0xffffu;
    if ((int)slot <= last_of_zero) {
        state = (last_of_zero + 1u) * (state >> 16) + slot;
        while (state < 1u << 23) state = state << 8 | (at < end ? *at++ : (damaged = true, 255u));
        continue;
    }
}

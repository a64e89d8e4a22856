// The stream of `count` symbols in `notes`, written from `bytes_end` down: rANS with 16 bits of probability (Duda 2013,
// arXiv 1311.2540; after Giesen, arXiv 1402.3392). Sets `size`, its bytes.

int size = 0;
unsigned state = 1u << 23;
for (int i = count - 1; i >= 0; --i) {
    const unsigned frequency = notes[i] >> 16, start = notes[i] & 0xffffu;
    while (state >= frequency << 15) {
        bytes_end[-++size] = (unsigned char)state;
        state >>= 8;
    }
    state = (state / frequency << 16) + state % frequency + start;
}
for (int i = 0; i < 4; ++i) {
    bytes_end[-++size] = (unsigned char)state;
    state >>= 8;
}

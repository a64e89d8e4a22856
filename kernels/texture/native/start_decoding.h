// A stream's first four bytes are the state of its decoder. Names: `at` and `end` of the stream's bytes.

bool damaged = end - at < 4;
unsigned state = damaged ? 0u : (unsigned)at[0] << 24 | (unsigned)at[1] << 16 | (unsigned)at[2] << 8 | at[3];
at += 4;
if (state < 1u << 23) {
    damaged = true;
    state = 1u << 23;
}

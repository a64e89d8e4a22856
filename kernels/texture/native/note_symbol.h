// Notes how `value` will be coded, frequency and start in one word, for a coder that writes from the last to the first.
// Constant: RAW_BITS. Names: notes, count, value, centre, phase, table, and `last`, its last entry.

{
    const int from = phase < 0 ? centre - value : value - centre;
    int j = from > 0 ? 2 * from : 1 - 2 * from;
    const bool raw = j >= last;
    if (raw) j = last;
    const unsigned start = (table[j - 1] + 1u) & 0xffffu;
    notes[count++] = (table[j] + 1u - start) << 16 | start;
    if (raw) notes[count++] = 1u << (32 - RAW_BITS) | (unsigned)(value + (1 << (RAW_BITS - 1))) << (16 - RAW_BITS);
}

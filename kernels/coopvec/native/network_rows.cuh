// `row[i]`: the parameters of the network of row 8 i + g. `peers`: lanes with this lane's network, `rank` among them.
// Names: lanes.cuh, key, this lane's network.

const unsigned alike = __match_any_sync(0xffffffffu, key);  // lanes with this lane's network
const unsigned peers = __popc(alike), rank = __popc(alike & ((1u << lane) - 1u));
const unsigned* row[4];
#pragma unroll
for (int i = 0; i < 4; ++i)
    row[i] = reinterpret_cast<const unsigned*>(__shfl_sync(0xffffffffu, key, 8 * i + static_cast<int>(g)));

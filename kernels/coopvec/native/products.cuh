// Products by `wgmma`: descriptors of its operands, and when they run.

typedef unsigned long long Tile;
// matrix descriptor: 1024 bytes from 8 rows to the next 8, `beyond` from 64 columns to the next; of the last dz 256
auto tile = [](unsigned address, unsigned beyond) {
    return static_cast<Tile>(address >> 4 | beyond >> 4 << 16) | static_cast<Tile>(64u | 1u << 30) << 32; };
auto last_tile = [](unsigned address) {
    return static_cast<Tile>(address >> 4) | static_cast<Tile>(16u | 3u << 30) << 32; };
auto begin_products = []() { asm volatile("wgmma.fence.sync.aligned;" ::: "memory"); };
auto commit = []() { asm volatile("wgmma.commit_group.sync.aligned;" ::: "memory"); };
auto publish = []() { asm volatile("fence.proxy.async.shared::cta;" ::: "memory"); };  // own stores, to wgmma

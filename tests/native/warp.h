// A warp on the host, for CUDA text of whole warps: 32 threads that meet at each `mma`. PTX instructions are functions here
// (`emulated_warp.py`); float16 operations round once from double. Fragments: PTX ISA, "Matrix Fragments for mma.m16n8k16".
#include <algorithm>
#include <barrier>
#include <cmath>
#include <cstring>
#include <thread>
#include <vector>

using std::max;
using std::min;
using half = _Float16;
namespace wp {
using float32 = float;
using float16 = half;
using int32 = int;
using uint32 = unsigned;
using uint8 = unsigned char;
}
struct uint4 { unsigned x, y, z, w; };
struct float2 { float x, y; };
struct Index { unsigned x; };
template <class T> struct Array { T* data; };
struct Levels { Array<int> rows, columns; };
struct Params { Levels levels; Array<unsigned> latents; Array<int> starts; };
struct Vec4i { int c[4]; };
thread_local Index threadIdx;

template <class To, class From> To bits(From from) { To to; std::memcpy(&to, &from, sizeof(to)); return to; }
template <class T> T __ldg(const T* at) { return *at; }
float2 make_float2(float x, float y) { return {x, y}; }
float __saturatef(float x) { return x < 0 ? 0 : x > 1 ? 1 : x; }
unsigned __byte_perm(unsigned a, unsigned b, unsigned selector) {
    const unsigned long long both = (static_cast<unsigned long long>(b) << 32) | a;
    unsigned result = 0;
    for (int i = 0; i < 4; ++i) result |= ((both >> 8 * (selector >> 4 * i & 7)) & 255) << 8 * i;
    return result;
}
half part(unsigned v, int i) { return bits<half>(static_cast<unsigned short>(v >> 16 * i)); }
unsigned pair(double low, double high) {
    return bits<unsigned short>(half(low)) | static_cast<unsigned>(bits<unsigned short>(half(high))) << 16;
}
template <class F> unsigned each(F f) { return pair(f(0), f(1)); }
unsigned ptx_pack(float high, float low) { return pair(low, high); }
unsigned ptx_max(unsigned a, unsigned b) { return each([=](int i) { return max(part(a, i), part(b, i)); }); }
unsigned ptx_min(unsigned a, unsigned b) { return each([=](int i) { return min(part(a, i), part(b, i)); }); }
unsigned ptx_ex2(unsigned a) { return each([=](int i) { return std::exp2(double(part(a, i))); }); }
unsigned ptx_fma(unsigned a, unsigned b, unsigned c) {
    return each([=](int i) { return double(part(a, i)) * double(part(b, i)) + double(part(c, i)); });
}

unsigned shared_a[32][4], shared_b[32][2];
std::barrier meeting(32);
void ptx_mma(float (&d)[4], const float (&c)[4], const unsigned (&a)[4], unsigned b0, unsigned b1) {
    const unsigned lane = threadIdx.x, b[2] = {b0, b1};
    std::copy(a, a + 4, shared_a[lane]);
    std::copy(b, b + 2, shared_b[lane]);
    meeting.arrive_and_wait();
    for (int i = 0; i < 4; ++i) {
        const int row = lane / 4 + i / 2 * 8, column = lane % 4 * 2 + i % 2;
        double sum = c[i];
        for (int k = 0; k < 16; ++k) {
            const int word = k % 8 / 2, second = k / 8;
            sum += double(part(shared_a[row % 8 * 4 + word][row / 8 + 2 * second], k % 2)) *
                   double(part(shared_b[column * 4 + word][second], k % 2));
        }
        d[i] = sum;
    }
    meeting.arrive_and_wait();
}
void ptx_mma(unsigned (&d)[2], const unsigned (&c)[2], const unsigned (&a)[4], unsigned b0, unsigned b1) {
    float sums[4];
    for (int i = 0; i < 4; ++i) sums[i] = part(c[i / 2], i % 2);
    ptx_mma(sums, sums, a, b0, b1);
    for (int i = 0; i < 2; ++i) d[i] = pair(sums[2 * i], sums[2 * i + 1]);
}

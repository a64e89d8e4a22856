// So much of Metal's language that exported networks are C++.
#include <algorithm>
#include <cmath>
#include <cstring>

using uint = unsigned;
#define device
#define thread
#define constant const
#define kernel inline
namespace metal {
using std::abs;
using std::cos;
using std::exp;
using std::floor;
using std::fma;
using std::log;
using std::max;
using std::min;
using std::rint;
using std::sin;
using std::sqrt;
using std::tanh;
struct uint2 {
    uint x, y;
};
struct float4 {
    float x, y, z, w;
    float4(float x, float y, float z, float w) : x(x), y(y), z(z), w(w) {}
    float4& operator+=(const float4& other) {
        x += other.x, y += other.y, z += other.z, w += other.w;
        return *this;
    }
};
struct float4x4 {  // columns after each other
    float m[16];
    template <class... T> float4x4(T... values) : m{static_cast<float>(values)...} {}
    float4 operator*(const float4& v) const {
        auto row = [&](int i) { return m[i] * v.x + m[4 + i] * v.y + m[8 + i] * v.z + m[12 + i] * v.w; };
        return {row(0), row(1), row(2), row(3)};
    }
};
enum class access { write };
template <class T, access> struct texture2d {
    float4* pixels;
    uint width, height;
    uint get_width() const { return width; }
    uint get_height() const { return height; }
    void write(const float4& value, uint2 at) { pixels[at.y * width + at.x] = value; }
};
template <class To, class From> To as_type(From from) {
    To to;
    std::memcpy(&to, &from, sizeof(to));
    return to;
}
}

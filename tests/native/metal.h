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
template <class To, class From> To as_type(From from) {
    To to;
    std::memcpy(&to, &from, sizeof(to));
    return to;
}
}

// The device behind the stub headers: positions (m) from the file of AVC_POSITIONS, forces (N) to standard output.
//
// A line of positions holds x, y, z and the microseconds that reading them takes; time passes by that, and when somebody
// looks at the clock. When the positions have run out the device does not answer any more.
#ifndef RECORDED_DEVICE_HPP
#define RECORDED_DEVICE_HPP

#include <chrono>
#include <cstdio>
#include <cstdlib>

struct VirtualClock {
    typedef std::chrono::nanoseconds duration;
    typedef duration::rep rep;
    typedef duration::period period;
    typedef std::chrono::time_point<VirtualClock> time_point;

    static duration &time()
    {
        static duration passed(0);
        return passed;
    }

    static time_point now()
    {
        time() += std::chrono::microseconds(2);
        return time_point(time());
    }
};
#define AVC_CLOCK VirtualClock

namespace recorded {

inline bool read(double (&position_m)[3])
{
    static std::FILE *const file = std::fopen(std::getenv("AVC_POSITIONS"), "r");
    double took_us = 0.0;
    if (file == nullptr ||
        std::fscanf(file, "%la %la %la %la", &position_m[0], &position_m[1], &position_m[2], &took_us) != 4) {
        return false;
    }
    VirtualClock::time() += std::chrono::microseconds(static_cast<long>(took_us));
    return true;
}

inline void apply(double x, double y, double z)
{
    std::printf("force %a %a %a\n", x, y, z);
}

}  // namespace recorded

#endif

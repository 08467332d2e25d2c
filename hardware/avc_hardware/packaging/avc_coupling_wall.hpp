/* A plane wall in space for programs in C++11: the exported coupling along its normal, and the sample time kept.
 *
 * The coupling is certified for its own sample time and for no other: SampleClock waits for the next sample by a busy
 * loop, since a sleep is coarser than a sample. Give the thread the highest priority that the system has, and do nothing
 * slow in it: no graphics, no files, no printing.
 */
#ifndef AVC_COUPLING_WALL_HPP
#define AVC_COUPLING_WALL_HPP

#include <chrono>

#include "avc_coupling.h"

#ifndef AVC_CLOCK
#define AVC_CLOCK std::chrono::steady_clock
#endif

namespace avc_coupling_wall {

class Wall {
public:
    /* point_m: any point of the surface. normal: of length 1, out of the wall, to where the hand is. */
    Wall(const double (&point_m)[3], const double (&normal)[3])
    {
        for (int axis = 0; axis < 3; axis++) {
            point_m_[axis] = point_m[axis];
            normal_[axis] = normal[axis];
        }
        restart();
    }

    /* After a pause: no force before the device has been in front of the wall. */
    void restart()
    {
        avc_coupling_start(&coupling_);
        ready_ = false;
    }

    /* One sample: position (m) and force on the device (N) along the three axes of the device. */
    void step(const double (&position_m)[3], double (&force_n)[3])
    {
        double depth_m = 0.0;
        for (int axis = 0; axis < 3; axis++) {
            depth_m -= (position_m[axis] - point_m_[axis]) * normal_[axis];
        }
        ready_ = ready_ || depth_m <= 0.0;
        double out_n = 0.0;
        if (ready_) {
            out_n = static_cast<double>(avc_coupling_step(&coupling_, static_cast<avc_coupling_real_t>(depth_m)));
        }
        for (int axis = 0; axis < 3; axis++) {
            force_n[axis] = out_n * normal_[axis];
        }
    }

private:
    double point_m_[3], normal_[3];
    avc_coupling_t coupling_;
    bool ready_;
};

/* Tells when samples are due, and whether they are kept: one in a hundred may be missed or come early, ten in a row. */
class SampleClock {
public:
    SampleClock() : running_(false), owed_(0)
    {
    }

    /* Wait for the next sample. False: too many were missed; command no force any more. */
    bool wait()
    {
        begin(Clock::duration::zero());
        const bool kept = sample();
        while (Clock::now() < due_) {
        }
        return kept;
    }

    /* The same where something else calls once a sample. */
    bool arrived()
    {
        begin(period() / 2);
        return sample();
    }

private:
    typedef AVC_CLOCK Clock;
    enum : long { COST = 100, MOST_IN_A_ROW = 10, MOST_OWED = COST * MOST_IN_A_ROW };

    static Clock::duration period()
    {
        return std::chrono::duration_cast<Clock::duration>(
            std::chrono::duration<double>(static_cast<double>(AVC_COUPLING_SAMPLE_TIME_S)));
    }

    void begin(Clock::duration ago)
    {
        if (!running_) {
            due_ = Clock::now() - ago;
            running_ = true;
        }
    }

    bool sample()
    {
        const Clock::duration over = Clock::now() - due_;
        const bool early = over < Clock::duration::zero();
        const long missed = early ? 0 : static_cast<long>(over / period());
        due_ += early ? Clock::duration::zero() : (missed + 1) * period();
        const long wrong = early ? 1 : missed;
        owed_ += wrong <= MOST_IN_A_ROW ? wrong * COST : MOST_OWED + COST;
        owed_ -= owed_ > 0 ? 1 : 0;
        return owed_ <= MOST_OWED;
    }

    bool running_;
    Clock::time_point due_;
    long owed_;
};

}  // namespace avc_coupling_wall

#endif

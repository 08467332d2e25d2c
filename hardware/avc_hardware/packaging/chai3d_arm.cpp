/* A coupling whose gains follow place and contact normal, under a device of CHAI3D: a floor 2 cm below home.
 *
 *   c++ -std=c++11 -O2 -I<CHAI3D>/src chai3d_arm.cpp -lchai3d ...
 *
 * CHAI3D: metres, newtons; x towards the user, y to the right, z up; here the arm's x is forward and its y to the left.
 * Place of the proxy and normal come from the scene: put those of your own proxy where the floor's are. The gains hold
 * for their sample time alone, which the clock keeps. The velocity is that between two samples: getLinearVelocity() looks
 * back over 15 ms, with which these dampers do not hold.
 */
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>

#include "chai3d.h"

#include "avc_arm_gains.h"

#ifndef AVC_CLOCK
#define AVC_CLOCK std::chrono::steady_clock
#endif

namespace {

using chai3d::cVector3d;

chai3d::cGenericHapticDevicePtr device;
std::atomic<bool> running(true), finished(false);

struct Vector {
    double x, y, z;
};

double dot(const Vector &one, const Vector &other)
{
    return one.x * other.x + one.y * other.y + one.z * other.z;
}

Vector minus(const Vector &one, const Vector &other)
{
    return {one.x - other.x, one.y - other.y, one.z - other.z};
}

/* The coupling at one contact: gains of the first touch, kept until it ends. */
class Coupling {
public:
    /* Force on the device (N). proxy: where the scene holds the tip on the surface. normal: of length 1, out of the
     * wall. held: whether the proxy sticks, as by friction; otherwise it slides along. */
    Vector step(const Vector &tip, const Vector &proxy, const Vector &normal, bool held)
    {
        const Vector apart = minus(tip, proxy);
        const Vector moved = known_ ? minus(tip, before_) : Vector{0.0, 0.0, 0.0};
        before_ = tip;
        known_ = true;
        if (dot(apart, normal) >= 0.0) {
            touching_ = false;
            return {0.0, 0.0, 0.0};
        }
        if (!touching_) {
            const double home[3] = AVC_ARM_HOME_TIP_M;
            const double place[3] = {home[0] - tip.x, home[1] - tip.y, home[2] + tip.z};
            const double way[3] = {-normal.x, -normal.y, normal.z};
            gains_ = avc_arm_gains(place, way);
            touching_ = true;
        }
        const double rate = 1.0 / AVC_ARM_SAMPLE_TIME_S;
        const double out = std::max(0.0, -gains_.stiffness_n_per_m * dot(apart, normal) -
                                             gains_.damping_ns_per_m * rate * dot(moved, normal));
        const double spring = held ? gains_.tangent_stiffness_n_per_m : 0.0;
        const double damper = held ? gains_.tangent_damping_ns_per_m * rate : 0.0;
        const double inward = spring * dot(apart, normal) + damper * dot(moved, normal);
        Vector force = {out * normal.x - spring * apart.x - damper * moved.x + inward * normal.x,
                        out * normal.y - spring * apart.y - damper * moved.y + inward * normal.y,
                        out * normal.z - spring * apart.z - damper * moved.z + inward * normal.z};
#ifdef AVC_ARM_MAX_FORCE_N
        const double size = std::sqrt(dot(force, force));
        if (size > AVC_ARM_MAX_FORCE_N) {
            const double share = AVC_ARM_MAX_FORCE_N / size;
            force = {share * force.x, share * force.y, share * force.z};
        }
#endif
        return force;
    }

private:
    avc_arm_gains_t gains_ = avc_arm_gains_t();
    Vector before_ = {0.0, 0.0, 0.0};
    bool known_ = false, touching_ = false;
};

/* Waits for the next sample by a busy loop; false where ten in a row came late. */
class Clock {
public:
    bool wait()
    {
        typedef AVC_CLOCK Time;
        const Time::duration period = std::chrono::duration_cast<Time::duration>(
            std::chrono::duration<double>(static_cast<double>(AVC_ARM_SAMPLE_TIME_S)));
        const AVC_CLOCK::time_point next = started_ ? due_ + period : Time::now();
        const bool late = started_ && Time::now() > next;
        late_ = late ? late_ + 1 : 0;
        due_ = late ? Time::now() : next;
        started_ = true;
        while (Time::now() < due_) {
        }
        return late_ < 10;
    }

private:
    AVC_CLOCK::time_point due_;
    bool started_ = false;
    int late_ = 0;
};

void haptics()
{
    const Vector normal = {0.0, 0.0, 1.0};
    Coupling coupling;
    Clock clock;
    cVector3d position;
    while (running) {
        if (!clock.wait()) {
            std::fputs("stopped: the computer does not keep the sample time of the gains\n", stderr);
            break;
        }
        if (!device->getPosition(position)) {
            std::fputs("stopped: the device does not answer\n", stderr);
            break;
        }
        const Vector tip = {position.x(), position.y(), position.z()};
        const Vector proxy = {tip.x, tip.y, std::max(tip.z, -0.02)};
        const Vector force = coupling.step(tip, proxy, normal, false);
        device->setForce(cVector3d(force.x, force.y, force.z));
    }
    device->setForce(cVector3d(0.0, 0.0, 0.0));
    finished = true;
}

}  // namespace

int main()
{
    chai3d::cHapticDeviceHandler handler;
    if (!handler.getDevice(device, 0) || !device->open() || !device->calibrate()) {
        std::fputs("no haptic device\n", stderr);
        return 1;
    }
    chai3d::cThread thread;
    thread.start(haptics, chai3d::CTHREAD_PRIORITY_HAPTICS);
    std::puts("return ends");
    std::getchar();
    running = false;
    while (!finished) {
        chai3d::cSleepMs(10);
    }
    device->close();
    return 0;
}

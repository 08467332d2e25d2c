/* The wall under a device of CHAI3D, a floor 2 cm below the middle of the workspace.
 *
 *   c++ -std=c++11 -O2 -Isrc -I<CHAI3D>/src examples/chai3d.cpp src/avc_coupling.c -lchai3d ...
 *
 * CHAI3D: metres, newtons; x towards the user, y to the right, z up. Its haptic thread runs as fast as it can: the
 * SampleClock paces it. Some devices let setForce() wait for their own cycle, which must be shorter than a sample. The
 * coupling takes its velocity from the positions of its own samples: getLinearVelocity() looks back over 15 ms, with
 * which dampers that were certified do not hold.
 */
#include <atomic>
#include <cstdio>

#include "chai3d.h"

#include "avc_coupling_wall.hpp"

namespace {

chai3d::cGenericHapticDevicePtr device;
std::atomic<bool> running(true), finished(false);

void haptics()
{
    avc_coupling_wall::Wall wall({0.0, 0.0, -0.02}, {0.0, 0.0, 1.0});
    avc_coupling_wall::SampleClock clock;
    chai3d::cVector3d position;
    while (running) {
        if (!clock.wait()) {
            std::fputs("stopped: the computer does not keep the coupling's sample time\n", stderr);
            break;
        }
        if (!device->getPosition(position)) {
            std::fputs("stopped: the device does not answer\n", stderr);
            break;
        }
        const double position_m[3] = {position.x(), position.y(), position.z()};
        double force_n[3];
        wall.step(position_m, force_n);
        device->setForce(chai3d::cVector3d(force_n[0], force_n[1], force_n[2]));
    }
    device->setForce(chai3d::cVector3d(0.0, 0.0, 0.0));
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

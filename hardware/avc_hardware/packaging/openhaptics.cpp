/* The wall under a device of OpenHaptics, a floor 2 cm below the origin of the device.
 *
 *   c++ -std=c++11 -O2 -Isrc examples/openhaptics.cpp src/avc_coupling.c -lHD -lHDU ...
 *
 * OpenHaptics: millimetres, newtons; x to the right, y up, z towards the user. The scheduler calls once a sample: its rate
 * is set to that of the coupling, and refused where the device does not have it. The SampleClock watches it.
 */
#include <cstdio>

#include <HD/hd.h>
#include <HDU/hduError.h>

#include "avc_coupling_wall.hpp"

namespace {

struct Session {
    avc_coupling_wall::Wall wall;
    avc_coupling_wall::SampleClock clock;
};

HDCallbackCode HDCALLBACK render(void *data)
{
    Session &session = *static_cast<Session *>(data);
    const bool kept = session.clock.arrived();
    const HHD device = hdGetCurrentDevice();
    hdBeginFrame(device);
    HDdouble position_mm[3] = {0.0, 0.0, 0.0};
    hdGetDoublev(HD_CURRENT_POSITION, position_mm);
    const HDErrorInfo error = hdGetError();
    const bool answers = !HD_DEVICE_ERROR(error) || !hduIsSchedulerError(&error);
    double force_n[3] = {0.0, 0.0, 0.0};
    if (HD_DEVICE_ERROR(error)) {
        session.wall.restart(); /* after too much force or speed the driver has cut the force */
    } else if (kept) {
        const double position_m[3] = {1e-3 * position_mm[0], 1e-3 * position_mm[1], 1e-3 * position_mm[2]};
        session.wall.step(position_m, force_n);
    }
    hdSetDoublev(HD_CURRENT_FORCE, force_n);
    hdEndFrame(device);
    if (!kept) {
        std::fputs("stopped: the scheduler does not keep the coupling's sample time\n", stderr);
        return HD_CALLBACK_DONE;
    }
    if (!answers) {
        std::fputs("stopped: the device does not answer\n", stderr);
        return HD_CALLBACK_DONE;
    }
    return HD_CALLBACK_CONTINUE;
}

bool failed(const char *what)
{
    const HDErrorInfo error = hdGetError();
    if (HD_DEVICE_ERROR(error)) {
        hduPrintError(stderr, &error, what);
        return true;
    }
    return false;
}

}  // namespace

int main()
{
    const HHD device = hdInitDevice(HD_DEFAULT_DEVICE);
    if (failed("no haptic device")) {
        return 1;
    }
    hdEnable(HD_FORCE_OUTPUT);
    hdSetSchedulerRate(static_cast<HDulong>(1.0 / static_cast<double>(AVC_COUPLING_SAMPLE_TIME_S) + 0.5));
    if (failed("the device has no such rate: make a coupling for one that it has")) {
        hdDisableDevice(device);
        return 1;
    }
    Session session = {avc_coupling_wall::Wall({0.0, -0.02, 0.0}, {0.0, 1.0, 0.0}), avc_coupling_wall::SampleClock()};
    const HDSchedulerHandle callback = hdScheduleAsynchronous(render, &session, HD_MAX_SCHEDULER_PRIORITY);
    hdStartScheduler();
    std::puts("return ends");
    std::getchar();
    hdStopScheduler();
    hdUnschedule(callback);
    hdDisableDevice(device);
    return 0;
}

/* The wall under an Inverse3 of Haply, by its C++ HardwareAPI: a floor in the middle of the workspace.
 *
 *   c++ -std=c++11 -O2 -Isrc -I<HardwareAPI>/include examples/haply.cpp src/avc_coupling.c -lHaply.HardwareAPI ...
 *
 * HardwareAPI: metres, newtons; z up. One exchange sends a force and brings the position: the force of a position goes
 * out with the next exchange, a sample later. Make the coupling for a device with that sample in delay_samples. The
 * exchange itself waits for the device; the SampleClock paces it.
 */
#include <csignal>
#include <cstdio>

#include <HardwareAPI.h>

#include "avc_coupling_wall.hpp"

namespace {

volatile std::sig_atomic_t running = 1;

void stop(int)
{
    running = 0;
}

}  // namespace

int main(int count, char **arguments)
{
    if (count != 2) {
        std::fputs("usage: haply PORT\n", stderr);
        return 2;
    }
    Haply::HardwareAPI::IO::SerialStream stream(arguments[1]);
    Haply::HardwareAPI::Devices::Inverse3 device(&stream);
    device.SendDeviceWakeup();
    if (device.ReceiveDeviceInfo() < 0) {
        std::fputs("no Inverse3 answers\n", stderr);
        return 1;
    }
    avc_coupling_wall::Wall wall({0.0, 0.0, 0.17}, {0.0, 0.0, 1.0});
    avc_coupling_wall::SampleClock clock;
    float force_n[3] = {0.0f, 0.0f, 0.0f};
    const char *fault = nullptr;
    std::signal(SIGINT, stop); /* the device would keep the last force */
    std::puts("Ctrl-C ends");
    while (running != 0) {
        if (!clock.wait()) {
            fault = "the computer does not keep the coupling's sample time";
            break;
        }
        float position[3], velocity[3];
        device.SendEndEffectorForce(force_n);
        if (device.ReceiveEndEffectorState(position, velocity) < 0) {
            fault = "the device does not answer";
            break;
        }
        const double position_m[3] = {position[0], position[1], position[2]};
        double out_n[3];
        wall.step(position_m, out_n);
        for (int axis = 0; axis < 3; axis++) {
            force_n[axis] = static_cast<float>(out_n[axis]);
        }
    }
    device.SendEndEffectorForce();
    if (fault != nullptr) {
        std::fprintf(stderr, "stopped: %s\n", fault);
        return 1;
    }
    return 0;
}

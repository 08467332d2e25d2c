// What the example needs of Haply's HardwareAPI, over a recorded device.
#ifndef HARDWARE_API_STUB_H
#define HARDWARE_API_STUB_H

#include "recorded_device.hpp"

namespace Haply {
namespace HardwareAPI {
namespace IO {

class SerialStream {
public:
    explicit SerialStream(const char *) {}
};

}  // namespace IO
namespace Devices {

class Inverse3 {
public:
    explicit Inverse3(IO::SerialStream *, float = 5.0f) {}
    void SendDeviceWakeup() {}
    int ReceiveDeviceInfo() { return 0; }
    void SendEndEffectorForce() { recorded::apply(0.0, 0.0, 0.0); }
    void SendEndEffectorForce(const float force[3])
    {
        recorded::apply(static_cast<double>(force[0]), static_cast<double>(force[1]), static_cast<double>(force[2]));
    }
    int ReceiveEndEffectorState(float *position, float *velocity)
    {
        double position_m[3];
        const bool found = recorded::read(position_m);
        for (int axis = 0; axis < 3; axis++) {
            position[axis] = found ? static_cast<float>(position_m[axis]) : 0.0f;
            velocity[axis] = 0.0f;
        }
        return found ? 0 : -1;
    }
};

}  // namespace Devices
}  // namespace HardwareAPI
}  // namespace Haply

#endif

// What the example needs of CHAI3D 3.2, over a recorded device.
#ifndef CHAI3D_STUB_H
#define CHAI3D_STUB_H

#include <memory>

#include "recorded_device.hpp"

namespace chai3d {

class cVector3d {
public:
    explicit cVector3d(double a_x = 0.0, double a_y = 0.0, double a_z = 0.0) : m_x(a_x), m_y(a_y), m_z(a_z)
    {
    }
    double x() const { return m_x; }
    double y() const { return m_y; }
    double z() const { return m_z; }

private:
    double m_x, m_y, m_z;
};

class cGenericHapticDevice {
public:
    bool open() { return true; }
    bool close() { return true; }
    bool calibrate(bool = false) { return true; }
    bool getPosition(cVector3d &a_position)
    {
        double position_m[3];
        const bool found = recorded::read(position_m);
        a_position = found ? cVector3d(position_m[0], position_m[1], position_m[2]) : cVector3d();
        return found;
    }
    bool setForce(const cVector3d &a_force)
    {
        recorded::apply(a_force.x(), a_force.y(), a_force.z());
        return true;
    }
};
typedef std::shared_ptr<cGenericHapticDevice> cGenericHapticDevicePtr;

class cHapticDeviceHandler {
public:
    bool getDevice(cGenericHapticDevicePtr &a_device, unsigned int = 0)
    {
        a_device = std::make_shared<cGenericHapticDevice>();
        return true;
    }
};

enum CThreadPriority { CTHREAD_PRIORITY_GRAPHICS, CTHREAD_PRIORITY_HAPTICS };

class cThread {
public:
    void start(void (*a_function)(), CThreadPriority) { a_function(); }
};

inline void cSleepMs(unsigned int) {}

}  // namespace chai3d

#endif

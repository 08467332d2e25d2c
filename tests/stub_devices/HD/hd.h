// What the example needs of OpenHaptics 3, over a recorded device. The scheduler runs at 500, 1000 or 2000 Hz.
#ifndef HD_STUB_H
#define HD_STUB_H

#include <climits>

#include "recorded_device.hpp"

#define HDCALLBACK
typedef double HDdouble;
typedef unsigned char HDboolean;
typedef unsigned long HDulong;
typedef unsigned short HDushort;
typedef unsigned int HDenum;
typedef unsigned int HDerror;
typedef unsigned int HHD;
typedef const char *HDstring;
typedef unsigned int HDCallbackCode;
typedef unsigned long HDSchedulerHandle;
typedef HDCallbackCode(HDCALLBACK *HDSchedulerCallback)(void *pUserData);
typedef struct {
    HDerror errorCode;
    int internalErrorCode;
    HHD hHD;
} HDErrorInfo;

#define HD_SUCCESS 0x0000
#define HD_INVALID_VALUE 0x0101
#define HD_COMM_ERROR 0x0302
#define HD_CURRENT_POSITION 0x2050
#define HD_CURRENT_FORCE 0x2700
#define HD_FORCE_OUTPUT 0x4000
#define HD_MAX_SCHEDULER_PRIORITY USHRT_MAX
#define HD_DEFAULT_DEVICE NULL
#define HD_CALLBACK_DONE 0
#define HD_CALLBACK_CONTINUE 1
#define HD_DEVICE_ERROR(X) (((X).errorCode) != HD_SUCCESS)

namespace recorded {
struct Scheduler {
    HDSchedulerCallback callback;
    void *data;
    HDulong rate;
    HDerror error;
};
inline Scheduler &scheduler()
{
    static Scheduler only = {nullptr, nullptr, 1000, HD_SUCCESS};
    return only;
}
}  // namespace recorded

inline HHD hdInitDevice(HDstring) { return 0; }
inline HHD hdGetCurrentDevice() { return 0; }
inline void hdDisableDevice(HHD) {}
inline void hdEnable(HDenum) {}
inline void hdBeginFrame(HHD) {}
inline void hdEndFrame(HHD) {}
inline void hdStopScheduler() {}
inline void hdUnschedule(HDSchedulerHandle) {}

inline HDErrorInfo hdGetError()
{
    const HDErrorInfo error = {recorded::scheduler().error, 0, 0};
    recorded::scheduler().error = HD_SUCCESS;
    return error;
}

inline void hdGetDoublev(HDenum, HDdouble *params)
{
    double position_m[3] = {0.0, 0.0, 0.0};
    if (!recorded::read(position_m)) {
        recorded::scheduler().error = HD_COMM_ERROR;
    }
    for (int axis = 0; axis < 3; axis++) {
        params[axis] = 1000.0 * position_m[axis];
    }
}

inline void hdSetDoublev(HDenum, const HDdouble *params) { recorded::apply(params[0], params[1], params[2]); }

inline void hdSetSchedulerRate(HDulong nRate)
{
    recorded::scheduler().rate = nRate;
    recorded::scheduler().error = nRate == 500 || nRate == 1000 || nRate == 2000 ? HD_SUCCESS : HD_INVALID_VALUE;
}

inline HDSchedulerHandle hdScheduleAsynchronous(HDSchedulerCallback pCallback, void *pUserData, HDushort)
{
    recorded::scheduler().callback = pCallback;
    recorded::scheduler().data = pUserData;
    return 1;
}

inline void hdStartScheduler()
{
    const recorded::Scheduler &made = recorded::scheduler();
    do {
        VirtualClock::time() += std::chrono::nanoseconds(1000000000ul / made.rate);
    } while (made.callback(made.data) == HD_CALLBACK_CONTINUE);
}

#endif

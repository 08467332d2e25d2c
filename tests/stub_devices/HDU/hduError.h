// What the example needs of the utilities of OpenHaptics 3.
#ifndef HDU_ERROR_STUB_H
#define HDU_ERROR_STUB_H

#include <cstdio>

#include <HD/hd.h>

inline void hduPrintError(std::FILE *stream, const HDErrorInfo *error, const char *message)
{
    std::fprintf(stream, "%s: %x\n", message, error->errorCode);
}

inline HDboolean hduIsSchedulerError(const HDErrorInfo *error) { return error->errorCode == HD_COMM_ERROR; }

#endif

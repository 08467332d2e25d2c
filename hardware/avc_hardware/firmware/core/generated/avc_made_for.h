/* Generated from the scene's CasADi expressions, do not edit:
 * python -m avc_hardware.firmware_build generate */
#ifndef AVC_MADE_FOR_H
#define AVC_MADE_FOR_H

/* What this firmware is made for. Every source with numbers that depend on it asserts the whole numbers. */
#define AVC_MADE_FOR_SAMPLE_TIME_S 0.001f
#define AVC_MADE_FOR_SAMPLE_TIME_NS 1000000
#define AVC_MADE_FOR_COUNT_M 2.0e-06f
#define AVC_MADE_FOR_COUNT_PM 2000000
#define AVC_MADE_FOR_MAX_FORCE_N 50.0f

#endif

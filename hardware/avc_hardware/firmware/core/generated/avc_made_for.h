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

/* Gains beyond these are refused. */
#define AVC_MADE_FOR_MAX_DAMPING_NS_PER_M 100000.0f
#define AVC_MADE_FOR_MAX_STIFFNESS_N_PER_M 1.0e+08f
#define AVC_MADE_FOR_MAX_CONTACT_DAMPING_NS_PER_M 10000.0f

/* What is no plausible motion of the device, nor a plausible tick; 0: not watched. */
#define AVC_MADE_FOR_MAX_SPEED_M_PER_S 3.0f
#define AVC_MADE_FOR_MAX_ACCELERATION_M_PER_S2 1000.0f
#define AVC_MADE_FOR_MAX_ENERGY_J 0.2f
#define AVC_MADE_FOR_STUCK_SWING_N 12.5f
#define AVC_MADE_FOR_MAX_OVERRUNS 5.0f

#endif

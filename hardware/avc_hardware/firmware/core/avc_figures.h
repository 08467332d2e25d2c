/* What the generated parts of the control tick were made for; HELLO tells the host. */
#ifndef AVC_FIGURES_H
#define AVC_FIGURES_H

#include <stdint.h>

typedef struct {
    float hold_s;                 /* how long a lost estimate is kept */
    float slew_per_s;             /* largest relative change of a gain, a second; 0: no limit */
    float guard_damping_ns_per_m; /* most that the guard adds */
    float hand_m_per_unit;        /* how far the hand moves for a unit of the position: 1, or a handle's radius */
    uint16_t estimator;           /* 0 zero-crossing, 1 spectral-peak, 2 adaptive-notch, 3 fused */
    uint16_t passive;             /* 1: gains change without creating energy */
} avc_figures_t;

/* In a source of its own, so that no compiler builds its numbers into the code: an image can be given others. */
extern const avc_figures_t avc_figures;

#endif

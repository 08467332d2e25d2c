/* The exported C of a coupling behind a sensor that fails, on a released device by its equations.
 *
 *   m x'' = -b x' - friction - F, F the command of the sample `delay` samples ago, held for T; the encoder rounds x
 *
 * Velocities before positions (symplectic Euler) in 16 steps a sample. The command of a sample is 0 wherever the device
 * stands at rest outside; the energy that a passive wall has given by any moment is 0 at most. */
#include "avc_coupling.h"
#include "uniform.h"
#include <math.h>
#include <stdint.h>

enum { STEPS = 16, LINE = 16 };
enum { SOUND, GLITCH, NUMBER, ELSEWHERE, STUCK, CLIPPED, DROPPED, JITTER };

struct device {
    double mass, damping, friction, time, encoder, delay, unit; /* unit: metres at the handle for one of the position */
};
struct fault {
    double kind, share, least, most, longest; /* of samples; size of a glitch, m; samples of a fault that lasts */
};
struct found {
    double faults, outside_n, given_j, entry_j;
};

/* One run from a place at a speed; a spring above 0, within a limit, stands in place of the coupling. */
void faulty_sensor(const struct device *d, const struct fault *fault, double spring, double limit, double start,
                   double speed, int samples, uint64_t seed, struct found *found)
{
    const double h = d->time / STEPS;
    const int kind = (int)fault->kind, late = (int)d->delay, resting = speed == 0.0;
    double x = start, v = speed, line[LINE] = {0}, held = 0.0, asked = 0.0, given = 0.0, before = start;
    int left = 0; /* samples of the fault that lasts */
    avc_coupling_t coupling;
    state = seed * 0x9E3779B97F4A7C15u + 1u;
    avc_coupling_start(&coupling);
    *found = (struct found){.entry_j = 0.5 * d->mass * speed * speed};
    for (int n = 0; n < samples; n++) {
        double seen = d->encoder > 0 ? d->encoder * floor(x / d->encoder + 0.5) : x;
        /* The first samples are sound: a device that is switched on is looked at. */
        const int begins = n > 20 && left == 0 && kind != SOUND && uniform() < fault->share;
        int called = 1, steps = STEPS;
        if (begins) {
            found->faults++;
            left = kind == STUCK || kind == ELSEWHERE ? 1 + (int)(uniform() * fault->longest) : 1;
            if (kind == GLITCH || kind == ELSEWHERE) {
                const double size = fault->least * pow(fault->most / fault->least, uniform());
                held = seen + (uniform() < 0.5 ? -size : size) / d->unit;
            } else if (kind == STUCK) {
                held = before;
            } else if (kind == NUMBER) {
                const double which = uniform();
                held = which < 0.4 ? NAN : which < 0.6 ? INFINITY : which < 0.8 ? -INFINITY : 3e38;
            }
        }
        if (kind == CLIPPED) {
            found->faults += seen < 0;
            seen = fmax(seen, 0.0);
        } else if (kind == JITTER) {
            found->faults++;
            steps = STEPS - STEPS / 4 + (int)(uniform() * (STEPS / 2 + 1));
        } else if (left > 0 && kind == DROPPED) {
            called = 0;
        } else if (left > 0) {
            seen = held;
        }
        left -= left > 0;
        before = seen;
        if (called) {
            asked = (double)avc_coupling_step(&coupling, (avc_coupling_real_t)seen);
            if (spring > 0) {
                asked = seen > 0 ? fmin(spring * seen, limit) : 0;
            }
        }
        if (resting && fabs(asked) > found->outside_n) {
            found->outside_n = fabs(asked);
        }
        for (int i = LINE - 1; i > 0; i--) {
            line[i] = line[i - 1];
        }
        line[0] = asked;
        for (int i = 0; i < steps; i++) {
            const double loss = h * d->friction / d->mass, moved = v;
            v += h / d->mass * (-d->damping * v - line[late]);
            v = fabs(v) > loss ? v - copysign(loss, v) : 0.0;
            given -= line[late] * 0.5 * (moved + v) * h;
            x += h * v;
            found->given_j = fmax(found->given_j, given);
        }
    }
}

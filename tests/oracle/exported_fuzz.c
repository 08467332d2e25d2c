/* Random positions for the exported C of a coupling, with faults: compiled with sanitizers.
 *
 * Ways of random length: strokes through the face, jumps, and rests outside of it. A twentieth of the samples is no
 * number, infinite or elsewhere. The force is a number and keeps its limit; where the device rests outside, whatever its
 * sensor says, it is 0 (not with detents, which act everywhere). */
#include "avc_coupling.h"
#include "uniform.h"
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

static double faulty(double place, double unit)
{
    const double kind = uniform(), size = 3e-3 * pow(1e9, uniform()) / unit;
    if (kind < 0.5) {
        return place + (uniform() < 0.5 ? -size : size);
    }
    return kind < 0.6 ? NAN : kind < 0.7 ? INFINITY : kind < 0.8 ? -INFINITY : kind < 0.9 ? 3e38 : -3e38;
}

int main(int count, char **words)
{
    if (count != 6) {
        return 2;
    }
    const long steps = atol(words[1]);
    const double limit = atof(words[3]) * 1.000001, unit = atof(words[4]);
    const int wall = atoi(words[5]);
    long outside = 0, pushed = 0;
    avc_coupling_t coupling;
    state = strtoull(words[2], NULL, 10) * 0x9E3779B97F4A7C15u + 1u;
    avc_coupling_start(&coupling);
    for (long done = 0; done < steps;) {
        const long lasts = 80 + (long)(400.0 * uniform());
        const double kind = uniform(), place = -(5e-3 + 0.1 * uniform()) / unit, high = 5e-3 * uniform() / unit;
        const double rate = 0.2 * uniform(), shift = 2e-3 * (uniform() - 0.5) / unit;
        if (uniform() < 0.2) {
            avc_coupling_start(&coupling);
        }
        for (long n = 0; n < lasts; n++, done++) {
            const int rests = kind < 0.4;
            double seen = rests ? place : kind < 0.8 ? shift + high * sin(rate * (double)n) : high * (2.0 * uniform() - 1.0);
            if (uniform() < 0.05) {
                seen = faulty(seen, unit);
            }
            const double force = (double)avc_coupling_step(&coupling, (avc_coupling_real_t)seen);
            pushed += force > 0.0;
            if (!(force <= limit && force >= -limit)) {
                printf("step %ld: %g N at %g\n", done, force, seen);
                return 1;
            }
            /* After a stroke that ended in the wall an observer may take some samples to see that it is out. */
            if (rests && n >= 50 && wall) {
                outside++;
                if (force != 0.0) {
                    printf("step %ld: %g N outside, seen at %g, rests at %g\n", done, force, seen, place);
                    return 1;
                }
            }
        }
    }
    printf("%ld %ld\n", outside, pushed);
    return 0;
}

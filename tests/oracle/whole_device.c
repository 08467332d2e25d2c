/* A haptic device by its equations, with a hand and the exported C of a coupling.
 *
 *   motor    m1 x1'' = -b x1' - friction - F + s,   s = k (x2 - x1) + c (x2' - x1')
 *   handle   (m2 + m) x2'' = -s + K (xt - x2) + B (xt' - x2') + W
 *   force    F' = a (u - F): the amplifier; u is the command of a sample, held, a delay late
 *
 * The hand is a mass m on the handle, with a spring K and a damper B to a target xt; W is a weight on the handle. The
 * encoder sees the motor. Velocities before positions (symplectic Euler) in steps that are short to everything here;
 * dry friction takes up to fc h of momentum in a step h and never turns the motion, so it sticks as it slides. Without a
 * resonance motor, handle and hand are one body. */
#include "avc_coupling.h"
#include <math.h>

enum { STEPS = 64, LINE = 8 };

struct device {
    double mass, damping, time, delay, friction, encoder, bandwidth, limit, resonance, ratio, share;
    double dropped; /* share of samples that are missed */
};
struct deed {
    double mass, damping, stiffness, weight; /* the hand */
    double start, velocity;                  /* of motor and handle */
    double speed, end;                       /* the target goes from start to end (at once without a speed), */
    double centre, swing, frequency, until;  /* swings about a centre until then, and stays at the end */
};
struct found {
    double motor_speed, handle_speed, force, motor, handle, most; /* over the tail: largest, largest, means; largest */
};

static void aim(const struct deed *p, double t, double *xt, double *vt)
{
    const double arrival = p->speed > 0 ? (p->end - p->start) / p->speed : 0, w = 2 * acos(-1.0) * p->frequency;
    *xt = p->end;
    *vt = 0;
    if (t < arrival) {
        *xt = p->start + p->speed * t;
        *vt = p->speed;
    } else if (t < p->until) {
        *xt = p->centre + p->swing * sin(w * (t - arrival));
        *vt = p->swing * w * cos(w * (t - arrival));
    }
}

void whole_device(const struct device *d, const struct deed *p, int samples, int tail, struct found *found)
{
    const double h = d->time / STEPS, w = 2 * acos(-1.0) * d->resonance;
    const double m2 = d->share * d->mass, m1 = d->mass - m2, k = m1 * m2 / d->mass * w * w;
    const double c = w > 0 ? 2 * d->ratio * k / w : 0, m = d->mass + p->mass, lag = 1 - exp(-2 * acos(-1.0) * d->bandwidth * h);
    const int late = (int)lround(d->delay * STEPS);
    double x1 = p->start, x2 = p->start, v1 = p->velocity, v2 = p->velocity, force = 0, line[LINE] = {0};
    unsigned draw = 1;
    avc_coupling_t coupling;
    *found = (struct found){0};
    avc_coupling_start(&coupling);
    for (int n = 0; n < samples; n++) {
        const double seen = d->encoder > 0 ? d->encoder * floor(x1 / d->encoder + 0.5) : x1;
        /* A computer that misses a sample does nothing: what it asked for stays, and its law does not see the time pass. */
        draw = 1664525u * draw + 1013904223u;
        const double asked = draw < d->dropped * 4294967296.0 ? line[0] : avc_coupling_step(&coupling, (float)seen);
        for (int i = LINE - 1; i > 0; i--) {
            line[i] = line[i - 1];
        }
        line[0] = fmax(-d->limit, fmin(d->limit, asked));
        for (int i = 0; i < STEPS; i++) {
            double xt, vt;
            aim(p, (n + (double)i / STEPS) * d->time, &xt, &vt);
            const double spring = k * (x2 - x1) + c * (v2 - v1), loss = h * d->friction / m1;
            const double hand = p->stiffness * (xt - x2) + p->damping * (vt - v2) + p->weight;
            /* The command of the sample that was `late` steps ago. */
            force += lag * (line[i >= late ? 0 : (late - i + STEPS - 1) / STEPS] - force);
            if (d->resonance > 0) {
                v1 += h / m1 * (spring - d->damping * v1 - force);
                v1 = fabs(v1) > loss ? v1 - copysign(loss, v1) : 0;
                v2 += h / (m2 + p->mass) * (hand - spring);
            } else {
                v1 += h / m * (hand - d->damping * v1 - force);
                v1 = fabs(v1) > h * d->friction / m ? v1 - copysign(h * d->friction / m, v1) : 0;
                v2 = v1;
            }
            x1 += h * v1;
            x2 += h * v2;
            found->most = fmax(found->most, fabs(force));
            if (n >= samples - tail) {
                found->motor_speed = fmax(found->motor_speed, fabs(v1));
                found->handle_speed = fmax(found->handle_speed, fabs(v2));
                found->force += force / ((double)tail * STEPS);
                found->motor += x1 / ((double)tail * STEPS);
                found->handle += x2 / ((double)tail * STEPS);
            }
        }
    }
}

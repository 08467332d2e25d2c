/* A device under measurement, from Newton's law: motor and handle, an amplifier that lags, a line of delay, dry friction
 * that stops and holds, a noisy encoder that rounds, and a controller that may close the loop. Heun's rule in small steps.
 */
#include <math.h>

enum { SUBSTEPS = 200 };

typedef struct {
    double mass, damping, coulomb, asymmetry, breakaway, slow, delay, bandwidth, resonance, ratio, share, at_handle,
        encoder, offset, drift, scale, ground, period, spring, damper;
} device_t;

typedef struct {
    double x, v, xh, vh;
} state_t;

static double friction(const device_t *d, double v, double pushing)
{
    double more = d->coulomb + (d->breakaway > 0 ? d->breakaway * exp(-(v / d->slow) * (v / d->slow)) : 0.0);
    if (v > 0) return more + d->asymmetry;
    if (v < 0) return -(more - d->asymmetry);
    return fmin(fmax(pushing, -(more - d->asymmetry)), more + d->asymmetry);
}

static void forces(const device_t *d, const state_t *s, double actual, double push, double *motor, double *handle)
{
    double share = d->resonance > 0 ? d->share : 0.0, joint = 0.0;
    double held = -d->ground * (d->resonance > 0 ? s->xh : s->x);
    if (d->resonance > 0) {
        double omega = 2 * 3.14159265358979323846 * d->resonance, reduced = d->mass * share * (1 - share);
        joint = reduced * omega * omega * (s->xh - s->x) + 2 * d->ratio * omega * reduced * (s->vh - s->v);
        *handle = -joint + held;
    } else {
        *handle = 0.0;
    }
    *motor = d->scale * actual + push - d->damping * s->v + joint + (d->resonance > 0 ? 0.0 : held);
}

/* Arrays have `samples` entries; noise and tremble are given. Writes position as measured and force as commanded. */
void measured_device(const device_t *d, int samples, const double *wanted, const double *noise, const double *tremble,
                     double *position, double *force)
{
    state_t s = {0, 0, 0, 0};
    double h = d->period / SUBSTEPS, actual = 0, before = 0;
    double share = d->resonance > 0 ? d->share : 0.0, motor = d->mass * (1 - share), handle = d->mass * share;
    double keep = d->bandwidth > 0 ? exp(-2 * 3.14159265358979323846 * d->bandwidth * h) : 0.0;
    double mean = d->bandwidth > 0 ? (1 - keep) / (2 * 3.14159265358979323846 * d->bandwidth * h) : 0.0;
    long late = lround(d->delay * SUBSTEPS);
    for (int k = 0; k < samples; k++) {
        double seen = (d->at_handle > 0 && d->resonance > 0 ? s.xh : s.x) + noise[k];
        double y = d->encoder > 0 ? d->encoder * floor(seen / d->encoder + 0.5) : seen;
        position[k] = y;
        force[k] = wanted[k] - d->spring * y - (k ? d->damper * (y - before) / d->period : 0.0);
        before = y;
        for (int i = 0; i < SUBSTEPS; i++) {
            long substep = (long)k * SUBSTEPS + i - late;
            double asked = substep < 0 ? force[0] : force[substep / SUBSTEPS];
            double push = d->offset + d->drift * k * d->period + tremble[k];
            double applied = asked + (actual - asked) * mean; /* the mean of the lag over the step */
            double m1, h1, m2, h2, dry;
            if (!(d->bandwidth > 0)) applied = asked;
            actual = asked + (actual - asked) * keep;
            forces(d, &s, applied, push, &m1, &h1);
            dry = friction(d, s.v, m1);
            state_t trial = {s.x + h * s.v, s.v + h * (m1 - dry) / motor, s.xh + h * s.vh,
                             share > 0 ? s.vh + h * h1 / handle : 0.0};
            forces(d, &trial, applied, push, &m2, &h2);
            double v = s.v + h * ((m1 + m2) / 2 - dry) / motor;
            if (s.v == 0 && fabs(dry) == fabs(m1)) v = 0;       /* held */
            else if (s.v * v < 0) v = 0;                        /* stopped within the step */
            s.x += h * (s.v + v) / 2;
            s.v = v;
            if (share > 0) {
                double vh = s.vh + h * (h1 + h2) / 2 / handle;
                s.xh += h * (s.vh + vh) / 2;
                s.vh = vh;
            } else {
                s.xh = s.x;
                s.vh = s.v;
            }
        }
    }
}

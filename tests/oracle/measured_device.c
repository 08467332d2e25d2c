/* A device under measurement, from Newton's law: motor and handle, an amplifier that lags, a line of delay, dry friction
 * that stops and holds, a noisy encoder that rounds, and a controller that may close the loop. Heun's rule in small steps.
 */
#include <math.h>

enum { SUBSTEPS = 200 };

typedef struct {
    double mass, damping, coulomb, asymmetry, breakaway, slow, delay, bandwidth, resonance, ratio, share, at_handle,
        encoder, offset, drift, scale, ground, period, spring, damper, rooted, loop_damping;
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
    *motor = d->scale * actual + push - d->damping * s->v + joint + (d->resonance > 0 ? 0.0 : held) - d->rooted * s->x;
}

/* The force commanded for a step, counted from the start. */
static double asked(const double *force, long substep)
{
    return substep < 0 ? force[0] : force[substep / SUBSTEPS];
}

/* One step of Heun's rule in which the motor does not turn; returns its velocity at the end. */
static double stepped(const device_t *d, const state_t *s, double h, double applied, double push, state_t *after)
{
    double share = d->resonance > 0 ? d->share : 0.0, motor = d->mass * (1 - share), handle = d->mass * share;
    double m1, h1, m2, h2, dry;
    forces(d, s, applied, push, &m1, &h1);
    dry = friction(d, s->v, m1);
    state_t trial = {s->x + h * s->v, s->v + h * (m1 - dry) / motor, s->xh + h * s->vh,
                     share > 0 ? s->vh + h * h1 / handle : 0.0};
    forces(d, &trial, applied, push, &m2, &h2);
    after->v = s->v + h * ((m1 + m2) / 2 - dry) / motor;
    if (s->v == 0 && dry == m1) after->v = 0; /* held */
    after->x = s->x + h * (s->v + after->v) / 2;
    after->vh = share > 0 ? s->vh + h * (h1 + h2) / 2 / handle : after->v;
    after->xh = share > 0 ? s->xh + h * (s->vh + after->vh) / 2 : after->x;
    return after->v;
}

/* One step, in two where the motor turns: what it does from rest on is decided when it rests, not at the next step. */
static void advance(const device_t *d, state_t *s, double h, double applied, double push)
{
    state_t after;
    double v = stepped(d, s, h, applied, push, &after);
    if (s->v * v < 0) {
        double until = h * s->v / (s->v - v);
        stepped(d, s, until, applied, push, &after);
        after.v = 0;
        if (!(d->resonance > 0)) after.vh = 0;
        *s = after;
        stepped(d, s, h - until, applied, push, &after);
    }
    *s = after;
}

/* A time in which the force asked for stays: the amplifier's lag acts with its mean. A current loop is stepped by the
 * trapezoidal rule, solved for its rate. */
static void driven(const device_t *d, state_t *s, double h, double asked_for, double push, double actual[2])
{
    double applied = asked_for, rate = 2 * 3.14159265358979323846 * d->bandwidth * h;
    if (d->bandwidth > 0 && d->loop_damping > 0) {
        double w = rate / h, z = d->loop_damping, was = actual[0], slope = actual[1];
        double pull = w * w * (asked_for - was - h * slope / 4) - z * w * slope;
        actual[1] = (slope + h * pull) / (1 + z * w * h + w * w * h * h / 4);
        actual[0] = was + h * (slope + actual[1]) / 2;
        applied = (was + actual[0]) / 2;
    } else if (d->bandwidth > 0) {
        double keep = exp(-rate);
        applied += (actual[0] - asked_for) * (1 - keep) / rate;
        actual[0] = asked_for + (actual[0] - asked_for) * keep;
    }
    advance(d, s, h, applied, push);
}

/* Arrays have `samples` entries; noise and tremble are given. Writes position as measured and force as commanded. */
void measured_device(const device_t *d, int samples, const double *wanted, const double *noise, const double *tremble,
                     double *position, double *force)
{
    state_t s = {0, 0, 0, 0};
    double h = d->period / SUBSTEPS, actual[2] = {0, 0}, before = 0;
    for (int k = 0; k < samples; k++) {
        double seen = (d->at_handle > 0 && d->resonance > 0 ? s.xh : s.x) + noise[k];
        double y = d->encoder > 0 ? d->encoder * floor(seen / d->encoder + 0.5) : seen;
        position[k] = y;
        force[k] = wanted[k] - d->spring * y - (k ? d->damper * (y - before) / d->period : 0.0);
        before = y;
        for (int i = 0; i < SUBSTEPS; i++) {
            /* Where a force arrives within the step, the step has two parts. */
            double from = (double)k * SUBSTEPS + i - d->delay * SUBSTEPS, part = from - floor(from);
            double older = asked(force, (long)floor(from)), newer = part > 0 ? asked(force, (long)floor(from) + 1) : older;
            double push = d->offset + d->drift * k * d->period + tremble[k];
            driven(d, &s, newer == older ? h : h * (1 - part), older, push, actual);
            if (newer != older) driven(d, &s, h * part, newer, push, actual);
        }
    }
}

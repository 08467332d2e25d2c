/* A device that renders a spring and a damper, from Newton's law, with what can make it buzz: delay, an amplifier that
 * lags, a handle on a spring, an encoder, missed ticks, a hand that lets go. Velocities before positions in small steps.
 */
#include <math.h>

enum { SUBSTEPS = 100 };

typedef struct {
    double mass, damping, friction, delay, lag, bandwidth, resonance, ratio, share, encoder, limit, period;
    double stiffness, damper, keep, two_sided;          /* F = k y + b y', keep: share of the old velocity */
    double hand_mass, hand_damping, hand_stiffness;     /* until `release` (s) */
    double release, weight, start, speed, end, sway;    /* weight from `release` on; target from start to end */
} device_t;

/* Arrays have `samples` entries. `missed` is 1 where the computer does nothing; writes measured position and commanded
 * force along +position, of the missed ticks too. */
void buzzing_device(const device_t *d, int samples, const double *noise, const double *missed, double *position,
                    double *force)
{
    const double pi = 3.14159265358979323846, h = d->period / SUBSTEPS, w = 2 * pi * d->resonance;
    const double part = d->resonance > 0 ? d->share : 0.0, m1 = d->mass * (1 - part), m2 = d->mass * part;
    const double spring = m1 * part * w * w, damper = 2 * d->ratio * w * m1 * part;
    const double lag = d->bandwidth > 0 ? 1 - exp(-2 * pi * d->bandwidth * h) : 1.0;
    double x1 = d->start, x2 = d->start, v1 = 0, v2 = 0, actual = 0, before = d->start, rate = 0, asked[16] = {0};
    const long late = lround(d->delay * SUBSTEPS);
    if (d->encoder > 0) before = d->encoder * floor(before / d->encoder + 0.5);
    for (int k = 0; k < samples; k++) {
        const double seen = x1 + noise[k];
        const double y = d->encoder > 0 ? d->encoder * floor(seen / d->encoder + 0.5) : seen;
        const double held = k ? force[k - 1] : 0.0;
        position[k] = y;
        if (missed[k] > 0) {
            force[k] = held;
        } else {
            rate = d->keep * rate + (1 - d->keep) * (y - before) / d->period;
            before = y;
            double f = d->stiffness * y + d->damper * rate;
            if (!(d->two_sided > 0)) f = y > 0 ? fmax(f, 0) : 0;
            f = fmax(-d->limit, fmin(d->limit, f));
            for (int i = 15; i > 0; i--) asked[i] = asked[i - 1];
            asked[0] = f;
            force[k] = -asked[(int)d->lag];
        }
        for (int i = 0; i < SUBSTEPS; i++) {
            const double t = k * d->period + i * h;
            const long at = (long)k * SUBSTEPS + i - late;
            const double want = at < 0 ? 0.0 : force[at / SUBSTEPS];
            const int free = t >= d->release;
            double target = d->start + d->speed * t, moving = d->speed;
            if (target > d->end) { target = d->end + d->sway * sin(2 * pi * 0.7 * t); moving = 0; }
            const double grip = free ? d->weight : d->hand_stiffness * (target - (part > 0 ? x2 : x1)) +
                                                   d->hand_damping * (moving - (part > 0 ? v2 : v1));
            const double joint = part > 0 ? spring * (x2 - x1) + damper * (v2 - v1) : 0.0;
            const double moved = m1 + (part > 0 || free ? 0.0 : d->hand_mass), loss = h * d->friction / moved;
            actual += lag * (want - actual);
            v1 += h / moved * (actual + joint - d->damping * v1 + (part > 0 ? 0.0 : grip));
            v1 = fabs(v1) > loss ? v1 - copysign(loss, v1) : 0;
            if (part > 0) v2 += h / (m2 + (free ? 0.0 : d->hand_mass)) * (grip - joint);
            x1 += h * v1;
            x2 = part > 0 ? x2 + h * v2 : x1;
            if (!(part > 0)) v2 = v1;
        }
    }
}

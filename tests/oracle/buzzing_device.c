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
    double grab, bias, bias_from, notch, depth, width;
    double grip_stiffness, grip_damping;                /* between the device and the hand's mass; 0 joins them */
} device_t;

/* Arrays have `samples` entries. `missed` is 1 where the computer does nothing; writes measured position and commanded
 * force along +position, of the missed ticks too, and where the hand is. */
void buzzing_device(const device_t *d, int samples, const double *noise, const double *missed, double *position,
                    double *force, double *hand)
{
    const double pi = 3.14159265358979323846, h = d->period / SUBSTEPS, w = 2 * pi * d->resonance;
    const double part = d->resonance > 0 ? d->share : 0.0, m1 = d->mass * (1 - part), m2 = d->mass * part;
    const double spring = m1 * part * w * w, damper = 2 * d->ratio * w * m1 * part;
    const double lag = d->bandwidth > 0 ? 1 - exp(-2 * pi * d->bandwidth * h) : 1.0;
    double x1 = d->start, x2 = d->start, v1 = 0, v2 = 0, actual = 0, before = d->start, rate = 0, asked[16] = {0};
    double x3 = d->start, v3 = 0; /* of the hand's mass, behind a grip */
    const int behind = d->grip_stiffness > 0;
    const double held_mass = behind ? 0.0 : d->hand_mass;
    const long late = lround(d->delay * SUBSTEPS);
    /* (s^2 + depth width w s + w^2)/(s^2 + width w s + w^2), s = c (z - 1)/(z + 1), c for the right frequency */
    const double wn = 2 * pi * d->notch, c = d->notch > 0 ? wn / tan(wn * d->period / 2) : 0, cc = c * c + wn * wn;
    const double wide = d->width * wn * c, turn = 2 * (wn * wn - c * c), shallow = d->depth * wide;
    double in1 = d->start, in2 = d->start, out1 = d->start, out2 = d->start, origin = 0;
    int grabbed = !(d->grab > 0);
    if (d->encoder > 0) before = d->encoder * floor(before / d->encoder + 0.5);
    for (int k = 0; k < samples; k++) {
        const double seen = x1 + noise[k];
        const double y = d->encoder > 0 ? d->encoder * floor(seen / d->encoder + 0.5) : seen;
        const double held = k ? force[k - 1] : 0.0;
        position[k] = y;
        hand[k] = x2;
        if (missed[k] > 0) {
            force[k] = held;
        } else {
            double u = y;
            if (d->notch > 0) {
                u = ((cc + shallow) * y + turn * in1 + (cc - shallow) * in2 - turn * out1 - (cc - wide) * out2) /
                    (cc + wide);
                in2 = in1; in1 = y; out2 = out1; out1 = u;
            }
            rate = d->keep * rate + (1 - d->keep) * (u - before) / d->period;
            before = u;
            if (!grabbed && k * d->period >= d->grab) { grabbed = 1; origin = u; }
            double f = grabbed ? d->stiffness * (u - origin) + d->damper * rate : 0;
            if (k * d->period >= d->bias_from) f += d->bias;
            if (!(d->two_sided > 0)) f = u > 0 ? fmax(f, 0) : 0;
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
            const double xh = part > 0 ? x2 : x1, vh = part > 0 ? v2 : v1;
            const double arm = d->hand_stiffness * (target - (behind ? x3 : xh)) +
                               d->hand_damping * (moving - (behind ? v3 : vh));
            const double joined = behind ? d->grip_stiffness * (x3 - xh) + d->grip_damping * (v3 - vh) : arm;
            const double grip = free ? d->weight : joined;
            if (behind) {
                v3 += h / d->hand_mass * (arm - joined);
                x3 += h * v3;
            }
            const double joint = part > 0 ? spring * (x2 - x1) + damper * (v2 - v1) : 0.0;
            const double moved = m1 + (part > 0 || free ? 0.0 : held_mass), loss = h * d->friction / moved;
            actual += lag * (want - actual);
            v1 += h / moved * (actual + joint - d->damping * v1 + (part > 0 ? 0.0 : grip));
            v1 = fabs(v1) > loss ? v1 - copysign(loss, v1) : 0;
            if (part > 0) v2 += h / (m2 + (free ? 0.0 : held_mass)) * (grip - joint);
            x1 += h * v1;
            x2 = part > 0 ? x2 + h * v2 : x1;
            if (!(part > 0)) v2 = v1;
        }
    }
}

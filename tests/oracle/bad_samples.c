/* The exported C of a coupling behind a position sensor that tells nonsense for some samples, and before fast hands.
 *
 *   program bad RUNS SEED STEP UNIT           a device at rest outside, bad samples in a row: largest force, runs with one
 *   program strike RUNS SEED STEP UNIT SPEED SLOWEST FASTEST MASS DAMPING TIME DELAY     hands that strike: refused samples
 *
 * END is the kind of the coupling: WALL, ENGINE, HELD (an engine that hands out a force) or FOLLOWER, whose other end is
 * where the device is, or follows it in 5 ms. STEP: of the encoder, in the device's unit; UNIT: metres at the handle for
 * one of the device's unit. Bad samples begin with a jump of 20 mm to 0.5 m at the handle. */
#include "avc_coupling.h"
#include "uniform.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define WALL 0
#define ENGINE 1
#define HELD 2
#define FOLLOWER 3
#ifndef SCALE
#define SCALE 1.0
#endif

enum { STEPS = 16, LINE = 8, FADED = 600, LATER = 40 };
enum { EQUAL, COUNTS, DRIFT, DRIFT_AND_COUNTS, STRADDLE, NO_NUMBERS, KINDS };
static const double jump_m = 0.02, farthest_m = 0.5, drift_m = 1e-3, lag_s = 5e-3;

/* A coupling with its other end, if it has one. */
typedef struct {
    avc_coupling_t device;
#if END == FOLLOWER
    avc_coupling_t follower;
#endif
    double largest_n; /* of the forces on both ends in the last sample */
} pair_t;

static void begin(pair_t *pair)
{
#if END == WALL
    avc_coupling_start(&pair->device);
#elif END == FOLLOWER
    avc_coupling_init(&pair->device, &AVC_COUPLING_LEADER);
    avc_coupling_init(&pair->follower, &AVC_COUPLING_FOLLOWER);
#else
    avc_coupling_init(&pair->device);
#endif
    pair->largest_n = 0.0;
}

static void note(pair_t *pair, double force_n)
{
    pair->largest_n = fmax(pair->largest_n, isfinite(force_n) ? fabs(force_n) : INFINITY);
}

/* A sample: the force on the device. The other end is somewhere, as the device counts. */
static double sample(pair_t *pair, double seen, double other, double other_speed)
{
    const avc_coupling_real_t position = (avc_coupling_real_t)seen;
    double force;
    pair->largest_n = 0.0;
#if END == WALL
    (void)other, (void)other_speed;
    force = (double)avc_coupling_step(&pair->device, position);
#elif END == FOLLOWER
    const avc_coupling_message_t there = avc_coupling_message(&pair->device);
    avc_coupling_message_t back;
    (void)other_speed;
    note(pair, (double)avc_coupling_step(&pair->follower, (avc_coupling_real_t)(SCALE * other), &there));
    back = avc_coupling_message(&pair->follower);
    force = (double)avc_coupling_step(&pair->device, position, &back);
#else
    const avc_coupling_real_t tool = (avc_coupling_real_t)(SCALE * other), speed = (avc_coupling_real_t)(SCALE * other_speed);
    avc_coupling_real_t asked;
    avc_coupling_sample(&pair->device, position);
    asked = avc_coupling_tool_force(&pair->device, tool, speed);
    note(pair, (double)asked);
#if END == HELD
    force = (double)avc_coupling_force(&pair->device, asked);
#else
    force = (double)avc_coupling_force(&pair->device, tool, speed);
#endif
#endif
    note(pair, force);
    return force;
}

static double on_steps(double place, double step)
{
    return step * floor(place / step + 0.5);
}

static int below(int count)
{
    return (int)(uniform() * count);
}

static double nonsense(void)
{
    const double which = uniform();
    return which < 0.4 ? NAN : which < 0.6 ? INFINITY : which < 0.8 ? -INFINITY : 3e38;
}

/* The largest force that a device at rest gets in a run beyond that of one with a sound sensor. */
static void bad_samples(long runs, double step, double unit)
{
    static pair_t faulty, sound;
    double worst_n = 0.0;
    long forces = 0, bad = 0;
    for (long run = 0; run < runs; run++) {
        const double place = on_steps(-pow(10.0, -6.0 + 5.7 * uniform()) / unit, step);
        int left = 1 + below(60) + (END == WALL ? 0 : FADED), groups = 1 + below(3), in_row = 0, kind = 0, index = 0;
        double held = 0.0, towards = 0.0, given_n = 0.0, usual_n = 0.0;
        begin(&faulty);
        begin(&sound);
        while (left > 0 || in_row > 0 || groups > 0) {
            /* A count that flickers at the face itself is a movement into the wall. */
            double seen = place - (place < -1.5 * step && uniform() < 0.1 ? step : 0.0), clean;
            clean = seen;
            if (in_row == 0 && left == 0) {
                in_row = uniform() < 0.1 ? 1 : 2 + below(5);
                left = uniform() < 0.5 ? 1 + below(4) : LATER + below(60);
                left = --groups == 0 ? LATER + 60 : left;
                kind = below(KINDS);
                held = jump_m * pow(farthest_m / jump_m, uniform()) / unit * (uniform() < 0.75 ? 1.0 : -1.0);
                towards = (uniform() < 0.5 ? -drift_m : drift_m) / unit;
                index = 0;
            }
            if (in_row > 0) {
                const int counts = kind == COUNTS || kind == DRIFT_AND_COUNTS;
                const int drifts = kind == DRIFT || kind == DRIFT_AND_COUNTS;
                const double side = kind == STRADDLE && index % 2 == 1 ? -1.0 : 1.0;
                seen = place + side * held + (drifts ? index * towards : 0.0) + (counts ? (below(9) - 4) * step : 0.0);
                seen = on_steps(seen, step);
                /* On a coarse encoder the first one is not nearer for its counts. */
                seen = index == 0 && fabs(seen - place) < jump_m / unit ? place + held + copysign(step, held) : seen;
                seen = kind == NO_NUMBERS && uniform() < 0.5 ? nonsense() : seen;
                index++;
                in_row--;
                bad++;
            } else {
                left--;
            }
            (void)sample(&sound, clean, place, 0.0);
            (void)sample(&faulty, seen, place, 0.0);
            given_n = fmax(given_n, faulty.largest_n);
            usual_n = fmax(usual_n, sound.largest_n);
        }
        forces += given_n > usual_n;
        worst_n = fmax(worst_n, given_n - usual_n);
    }
    printf("%.9g %ld %ld\n", worst_n, forces, bad);
}

struct device {
    double mass, damping, time, step, unit;
    int delay;
};

/* One strike: the hand leads a grip, which speeds up, goes 5 mm into the wall, rests and comes back as fast. */
static void strike(const struct device *d, double speed, long *samples, long *refused, double *largest_n)
{
    const double unit = d->unit, inertia = unit * unit, h = d->time / STEPS;
    const double mass = d->mass + (0.05 + 0.25 * uniform()) * inertia;
    const double grip_b = (3 + 17 * uniform()) * inertia, grip_k = (200 + 600 * uniform()) * inertia;
    const double gain = 20 + 60 * uniform(), most = speed / unit, rate = gain / unit;
    const int thrown = uniform() < 0.5, in = (int)(0.1 / d->time);
    const double away = speed * speed / (2 * gain) + 0.002 + 0.02 * uniform(), depth = 0.005 / unit;
    double x = -away / unit, v = thrown ? most : 0.0, aim = x, pace = v, line[LINE] = {0}, other = x;
    int held = 0;
    pair_t pair;
    begin(&pair);
#if END != WALL
    for (int n = 0; n < FADED; n++) {
        (void)sample(&pair, on_steps(x - n % 2 * 0.0, d->step), x, 0.0);
    }
    v = pace = 0.0;
#endif
    for (int n = 0; n < 4000 && !(held > in && aim < -away / unit); n++) {
        const double force = sample(&pair, on_steps(x, d->step), other, 0.0);
        for (int i = LINE - 1; i > 0; i--) {
            line[i] = line[i - 1];
        }
        line[0] = force;
        (*samples)++;
        *refused += pair.device.sensor.missed != 0u;
        *largest_n = fmax(*largest_n, pair.largest_n);
        other += (x - other) * fmin(d->time / lag_s, 1.0);
        for (int i = 0; i < STEPS; i++) {
            const double wish = aim < depth && held <= in ? most : held <= in ? 0.0 : -most;
            pace = fmin(fmax(wish, pace - rate * h), pace + rate * h);
            aim += h * pace;
            v += h / mass * (-d->damping * v - line[d->delay] + grip_b * (pace - v) + grip_k * (aim - x));
            x += h * v;
        }
        held += aim >= depth;
    }
}

int main(int count, char **words)
{
    const long runs = count > 2 ? atol(words[2]) : 0;
    if (count < 6) {
        return 2;
    }
    state = strtoull(words[3], NULL, 10) * 0x9E3779B97F4A7C15u + 1u;
    if (strcmp(words[1], "bad") == 0) {
        bad_samples(runs, atof(words[4]), atof(words[5]));
        return 0;
    }
    if (count != 12) {
        return 2;
    }
    {
        const struct device d = {atof(words[8]), atof(words[9]), atof(words[10]), atof(words[4]), atof(words[5]), atoi(words[11])};
        long samples = 0, refused = 0;
        double largest_n = 0.0;
        for (long run = 0; run < runs; run++) {
            strike(&d, atof(words[6]) + (atof(words[7]) - atof(words[6])) * uniform(), &samples, &refused, &largest_n);
        }
        printf("%ld %ld %.9g\n", samples, refused, largest_n);
    }
    return 0;
}

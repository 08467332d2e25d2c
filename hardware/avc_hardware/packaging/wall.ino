/* The wall of the coupling on a device with one degree of freedom: a quadrature encoder on two interrupt pins, a motor
 * driver with PWM and direction. Set the numbers of your device; have an emergency stop at hand, begin with little @FORCE@.
 *
 * The coupling is certified for its own sample time and for no other, AVC_COUPLING_SAMPLE_TIME_S. loop() takes a sample
 * whenever one is due; nothing else that takes long may stand in it. Missed samples are counted: a board that misses more
 * than one in a hundred, or ten in a row, switches its motor off for good and says so. On a 16 MHz AVR a step takes 0.2 to
 * 2 ms; with gains that follow the frequency it is too slow for 1 kHz.
 */
#include <avc_coupling.h>

static const int ENCODER_A = 2, ENCODER_B = 3, MOTOR_PWM = 9, MOTOR_DIRECTION = 8;
/* Of the encoder @WAY@; counts rise into the wall, 0 is its surface. */
static const avc_coupling_real_t METRES_PER_COUNT = (avc_coupling_real_t)@PER_COUNT@;
/* What the handle feels at a duty cycle of 255, measured on your own driver: at first @LARGEST@; direction LOW pushes out of the wall. */
static const avc_coupling_real_t NEWTONS_AT_FULL_DUTY = (avc_coupling_real_t)@FULL_DUTY@;

static const unsigned long PERIOD_US = (unsigned long)(AVC_COUPLING_SAMPLE_TIME_S * 1e6f + 0.5f);
/* A missed sample costs this much, a good one pays back one. */
static const long MISSED_COSTS = 100, MOST_OWED = 10 * MISSED_COSTS;

static avc_coupling_t coupling;
static volatile long encoder_count;
static unsigned long due_us, samples, missed;
static long owed;
static bool stopped;

static void on_encoder_a()
{
    encoder_count += digitalRead(ENCODER_A) == digitalRead(ENCODER_B) ? -1 : 1;
}

static void on_encoder_b()
{
    encoder_count += digitalRead(ENCODER_A) == digitalRead(ENCODER_B) ? 1 : -1;
}

static void apply(avc_coupling_real_t force_n)
{
    const avc_coupling_real_t size_n = force_n < 0 ? -force_n : force_n;
    const avc_coupling_real_t duty = size_n / NEWTONS_AT_FULL_DUTY * 255;
    digitalWrite(MOTOR_DIRECTION, force_n < 0 ? HIGH : LOW);
    analogWrite(MOTOR_PWM, duty < 255 ? (int)duty : 255);
}

/* Whether a sample is due; counts those that were missed. */
static bool sample_is_due()
{
    const unsigned long now_us = micros();
    if ((long)(now_us - due_us) < 0) {
        return false;
    }
    const unsigned long over = (now_us - due_us) / PERIOD_US;
    due_us += (over + 1) * PERIOD_US;
    samples += over + 1;
    missed += over;
    owed += over < 10 ? (long)over * MISSED_COSTS : MOST_OWED + MISSED_COSTS;
    owed -= owed > 0 ? 1 : 0;
    return true;
}

void setup()
{
    Serial.begin(115200);
    pinMode(ENCODER_A, INPUT_PULLUP);
    pinMode(ENCODER_B, INPUT_PULLUP);
    pinMode(MOTOR_PWM, OUTPUT);
    pinMode(MOTOR_DIRECTION, OUTPUT);
    attachInterrupt(digitalPinToInterrupt(ENCODER_A), on_encoder_a, CHANGE);
    attachInterrupt(digitalPinToInterrupt(ENCODER_B), on_encoder_b, CHANGE);
    avc_coupling_start(&coupling);
    due_us = micros() + PERIOD_US;
}

void loop()
{
    if (stopped || !sample_is_due()) {
        return;
    }
    if (owed > MOST_OWED) {
        apply(0);
        stopped = true;
        Serial.print(F("stopped: too slow for a sample of "));
        Serial.print(PERIOD_US);
        Serial.println(F(" us"));
        return;
    }
    noInterrupts();
    const long count = encoder_count;
    interrupts();
    apply(avc_coupling_step(&coupling, (avc_coupling_real_t)count * METRES_PER_COUNT));
    if (samples >= 1000) {
        Serial.print(F("missed samples of 1000: "));
        Serial.println(missed);
        samples = missed = 0;
    }
}

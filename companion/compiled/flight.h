/* What one vehicle and several side by side have in common: a flight, and the functions that Python has. */

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

enum { RING = 128, ROW = 11 };

struct flight {
    int64_t cycles, steps_per_cycle;
    int64_t mocap_delay, attitude_delay, thrust_delay, report_delay; /* steps, below RING */
    int64_t strict;    /* stop where a frame would not simply be accepted */
    int64_t corrects;  /* correct the autopilot's horizon */
    double period_s, step_s, first_signal, report_age_s, sample_hz;
    double force_scale, noise_keep, noise_fresh[3], look_noise[2];
    const double *first_q, *first_setpoint, *airframe, *params, *law, *network, *rules, *carrier;
    const double *looks;    /* (cycles, 6) standard normals */
    const double *gusts;    /* (steps, 3) standard normals, in blocks that are used from their ends */
    int64_t block;
    const double *steady;   /* (steps, 3) force that is no noise, N, NED */
    const uint8_t *unseen;  /* (cycles) or none */
    const double *errors;   /* (samples, 2) of the autopilot's horizon, or none */
    const double *arms;     /* (steps, 12) or none */
    const double *ahead;    /* (cycles, 10) references */
    const double *known;    /* (cycles, 3) or none */
    double *rows;           /* (ROW, cycles) position, velocity, command in W; event, sent */
};

/* The length of a quaternion as Python's math.hypot works it out: scaled, summed with the bits that were lost, and
   corrected once (Borges, "An improved algorithm for hypot(a,b)", 2019). */
static void split_square(double x, double sign, double *sum, double *lost)
{
    const double t = x * 134217729.0, high = t - (t - x), low = x - high;
    const double parts[3] = {high * high, 2.0 * high * low, low * low};
    for (int i = 0; i < 3; i++) {
        const double before = *sum;
        *sum += sign * parts[i];
        lost[i] += (before - *sum) + sign * parts[i];
    }
}

static double exact_norm(double w, double x, double y, double z)
{
    const double v[4] = {fabs(w), fabs(x), fabs(y), fabs(z)};
    double most = 0.0, sum = 1.0, lost[3] = {0.0, 0.0, 0.0};
    int exponent;
    for (int i = 0; i < 4; i++) {
        if (v[i] != v[i])
            return NAN;
        most = v[i] > most ? v[i] : most;
    }
    if (most == 0.0 || isinf(most))
        return most;
    frexp(most, &exponent);
    if (exponent < -1000)
        return sqrt(w * w + x * x + y * y + z * z);
    const double scale = ldexp(1.0, -exponent);
    for (int i = 0; i < 4; i++)
        split_square(v[i] * scale, 1.0, &sum, lost);
    const double h = sqrt(sum - 1.0 + (lost[0] + lost[1] + lost[2]));
    split_square(h, -1.0, &sum, lost);
    return (h + (sum - 1.0 + (lost[0] + lost[1] + lost[2])) / (2.0 * h)) / scale;
}

static inline double norm(double w, double x, double y, double z)
{
#if LDBL_MANT_DIG == 64 /* enough bits to know the nearest double, but for one length in some hundred */
    const long double a = w, b = x, c = y, d = z, size = sqrtl(a * a + b * b + c * c + d * d);
    const double low = (double)(size - size * 0x1p-61L), high = (double)(size + size * 0x1p-61L);
    if (low == high && low > 1e-100 && low < 1e100)
        return low;
#endif
    return exact_norm(w, x, y, z);
}

#ifndef SOURCES
#define SOURCES ""
#endif

/* The digest of the source that this was compiled from: what is older is not used. */
const char *sources(void) { return SOURCES; }

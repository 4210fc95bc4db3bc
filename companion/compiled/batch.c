/* Flights in virtual time, WIDTH vehicles side by side: the loop of flight.c, with a vector of numbers for each number.

   Additions, products, quotients and roots of vectors are those of their elements, to the last bit. */

#include "flight.h"

#include <immintrin.h>

typedef double real __attribute__((vector_size(8 * WIDTH)));
typedef int64_t truth __attribute__((vector_size(8 * WIDTH)));

enum { LANES = WIDTH };

static inline real spread(double x) { return x - (real){0.0}; }

#if defined __AVX512DQ__ && WIDTH == 8
static inline real choice(truth c, real a, real b)
{
    return (real)_mm512_mask_blend_pd(_mm512_movepi64_mask((__m512i)c), (__m512d)b, (__m512d)a);
}
static inline int any(truth c) { return _mm512_movepi64_mask((__m512i)c) != 0; }
static inline real each_sqrt(real x) { return (real)_mm512_sqrt_pd((__m512d)x); }
static inline real gather(truth addresses) { return (real)_mm512_i64gather_pd((__m512i)addresses, NULL, 1); }
#elif defined __AVX2__ && WIDTH == 4
static inline real choice(truth c, real a, real b)
{
    return (real)_mm256_blendv_pd((__m256d)b, (__m256d)a, (__m256d)c);
}
static inline int any(truth c) { return _mm256_movemask_pd((__m256d)c) != 0; }
static inline real each_sqrt(real x) { return (real)_mm256_sqrt_pd((__m256d)x); }
static inline real gather(truth addresses) { return (real)_mm256_i64gather_pd(NULL, (__m256i)addresses, 1); }
#else
#error "WIDTH is 8 with AVX-512, 4 with AVX2"
#endif

static inline real each_fabs(real x) { return (real)((truth)x & INT64_MAX); }

#define NUMBER(x) spread(x)
#define COUNT(condition) choice(condition, spread(1.0), spread(0.0))
#define CHOICE(condition, a, b) choice(condition, a, b)
#define IF(condition) if (any(condition))
#define ELSE(condition) if (any(~(condition)))
#define OTHER(condition, before, x) choice(condition, before, x)

static inline real larger(real a, real b) { return choice((a >= b) | (a != a), a, b); }
static inline real smaller(real a, real b) { return choice((a <= b) | (a != a), a, b); }

#define EACH(name, takes, call)                                                                                              \
    static inline real each_##name takes                                                                                     \
    {                                                                                                                        \
        real y;                                                                                                              \
        for (int i = 0; i < LANES; i++)                                                                                      \
            y[i] = call;                                                                                                     \
        return y;                                                                                                            \
    }
EACH(sin, (real a), sin(a[i]))
EACH(cos, (real a), cos(a[i]))
EACH(tan, (real a), tan(a[i]))
EACH(atan, (real a), atan(a[i]))
EACH(atan2, (real a, real b), atan2(a[i], b[i]))
EACH(exp, (real a), exp(a[i]))
EACH(tanh, (real a), tanh(a[i]))
EACH(pow, (real a, real b), pow(a[i], b[i]))
EACH(copysign, (real a, real b), copysign(a[i], b[i]))
EACH(norm, (real a, real b, real c, real d), norm(a[i], b[i], c[i], d[i]))
#undef isfinite
#define isfinite(x) ((x) - (x) == 0.0)
#define sqrt each_sqrt
#define fabs each_fabs
#define sin each_sin
#define cos each_cos
#define tan each_tan
#define atan each_atan
#define atan2 each_atan2
#define exp each_exp
#define tanh each_tanh
#define pow each_pow
#define copysign each_copysign
#define norm each_norm

#include "traced.c"

struct memory {
    real airframe[step_before_size], filters[estimate_before_size], held[fly_memory_size];
    real horizons[send_before_size], last[5], wire[5], gust[3];
    real poses[RING][7], turns[RING][4], wires[RING][5]; /* of each step */
    real known_law[fly_known_size], known_rules[send_known_size];
    real given[fly_given_size], driven[step_driven_size];
    real stamp_s;
};

/* Parameters of all lanes, and the flights themselves. */
struct batch {
    const struct flight *flights[LANES];
    const struct flight *first;
    real params[estimate_params_size], law[fly_law_size], rules[send_rules_size], carrier[step_carrier_size];
    real report_age_s, force_scale, noise_keep, noise_fresh[3], look_noise[2];
    truth mocap_delay, attitude_delay, thrust_delay, report_delay;
    truth looks, gusts, errors, ahead, known, lanes; /* addresses of each lane's own */
    int alike;                                       /* all lanes have one reference */
};

#define EVERY(to, count, value)                                                                                              \
    for (int i = 0; i < (count); i++)                                                                                        \
        for (int lane = 0; lane < LANES; lane++) {                                                                           \
            const struct flight *f = b->flights[lane];                                                                       \
            (to)[i][lane] = (value);                                                                                         \
        }

/* Read numbers that stand one after another for each lane. */
static inline void take(real *to, int count, truth addresses)
{
    for (int i = 0; i < count; i++)
        to[i] = gather(addresses + i * (int64_t)sizeof(double));
}

/* Read, of a ring with rows of this size, what each lane had at another step; what was before the first is there. */
static inline void recall(real *to, int count, const real *ring, int size, truth steps, const struct batch *b)
{
    const truth rows = (steps & (RING - 1)) * (int64_t)(size * sizeof(real)) + (int64_t)(intptr_t)ring + b->lanes;
    for (int i = 0; i < count; i++)
        to[i] = gather(rows + i * (int64_t)sizeof(real));
}

static inline truth since(int64_t step, truth delay)
{
    const truth then = step - delay;
    return then & (then > 0);
}

static void remember_pose(struct memory *m, const struct batch *b, int64_t step)
{
    const double at = step * b->first->step_s * b->first->sample_hz;
    memcpy(m->poses[step % RING], m->airframe, 3 * sizeof(real));
    memcpy(m->poses[step % RING] + 3, m->airframe + 6, 4 * sizeof(real));
    if (b->first->errors) {
        const int64_t first = (int64_t)at;
        const real share = spread(at - first);
        real errors[horizon_turn_error_rad_size];
        take(errors, horizon_turn_error_rad_size, b->errors + 2 * first * (int64_t)sizeof(double));
        horizon_turn(errors, &share, m->turns[step % RING]);
    }
}

static truth seen_at(const struct batch *b, int64_t cycle)
{
    truth seen;
    for (int lane = 0; lane < LANES; lane++)
        seen[lane] = cycle > 0 && b->flights[lane]->unseen[cycle] ? 0 : -1;
    return seen;
}

static void see(struct memory *m, const struct batch *b, int64_t cycle, int64_t step)
{
    real pose[7], noise[6], measured[look_measured_size], after[estimate_before_size], accepted;
    const real now_s = spread(cycle * b->first->period_s);
    recall(pose, 7, m->poses[0], 7, since(step, b->mocap_delay), b);
    take(noise, 6, b->looks + 6 * cycle * (int64_t)sizeof(double));
    look(pose, noise, b->look_noise, measured);
    if (cycle == 0) {
        begin_estimate(measured, b->params, m->filters);
        m->stamp_s = now_s;
        return;
    }
    const real dt_s = now_s - m->stamp_s;
    estimate(m->filters, measured, &dt_s, b->params, after, &accepted);
    if (!b->first->unseen) {
        memcpy(m->filters, after, sizeof after);
        m->stamp_s = now_s;
        return;
    }
    const truth seen = seen_at(b, cycle);
    for (int i = 0; i < estimate_before_size; i++)
        m->filters[i] = choice(seen, after[i], m->filters[i]);
    m->stamp_s = choice(seen, now_s, m->stamp_s);
}

static void place_state(real *to, const real *filters)
{
    to[0] = spread(0.0);
    memcpy(to + fly_given_state_position_w_m, filters + estimate_before_motion_position, 3 * sizeof(real));
    memcpy(to + fly_given_state_velocity_w_mps, filters + estimate_before_motion_velocity, 3 * sizeof(real));
    memcpy(to + fly_given_state_q_w_flu_wxyz, filters + estimate_before_attitude_q, 4 * sizeof(real));
    memcpy(to + fly_given_state_rate_flu_radps, filters + estimate_before_attitude_rate, 3 * sizeof(real));
}

static real differ(const real *a, const real *b)
{
    truth differs = {0};
    for (int i = 0; i < 5; i++)
        differs |= a[i] != b[i];
    return COUNT(differs);
}

static void believed(const struct memory *m, const struct batch *b, int64_t step, real *q)
{
    real true_q[4], turn[4];
    const truth then = since(step, b->report_delay);
    recall(true_q, 4, m->poses[0] + 3, 7, then, b);
    if (b->first->errors) {
        recall(turn, 4, m->turns[0], 4, then, b);
        report(true_q, turn, q);
    } else {
        q[0] = true_q[0], q[1] = true_q[1], q[2] = -true_q[2], q[3] = -true_q[3];
    }
}

static void control(struct memory *m, const struct batch *b, int64_t cycle, int64_t step, real *row)
{
    real sending[send_given_size], setpoint[fly_setpoint_size], wire[5], *given = m->given;
    const real period_s = spread(b->first->period_s);
    const real age_s = cycle * b->first->period_s - (m->stamp_s + 0.0 - b->params[estimate_params_delay_s]);
    place_state(given, m->filters);
    given[fly_given_age_s] = age_s;
    if (b->alike)
        for (int i = 0; i < 10; i++)
            given[fly_given_ahead_position_w_m + i] = spread(b->first->ahead[10 * cycle + i]);
    else
        take(given + fly_given_ahead_position_w_m, 10, b->ahead + 10 * cycle * (int64_t)sizeof(double));
    memcpy(given + fly_given_last_q_w_flu_wxyz, m->last, 5 * sizeof(real));
    if (b->first->known)
        take(given + fly_given_known_accel_b_mps2, 3, b->known + 3 * cycle * (int64_t)sizeof(double));
    if (cycle == 0) {
        real network[begin_law_network_size];
        EVERY(network, begin_law_network_size, f->network[i])
        begin_law(given, b->law, &period_s, network, m->held);
    }
    fly(m->held, given, b->law, &period_s, m->known_law, m->held, setpoint, row + 6);
    memcpy(sending, setpoint, sizeof setpoint);
    sending[send_given_is_new] = differ(setpoint, m->last);
    memcpy(sending + send_given_last_q_w_flu_wxyz, m->wire, 5 * sizeof(real));
    place_state(sending + send_given_state_time_s, m->filters);
    sending[send_given_age_s] = age_s;
    believed(m, b, step, sending + send_given_autopilot_q_w_flu_wxyz);
    sending[send_given_autopilot_age_s] = b->report_age_s;
    if (b->first->corrects)
        send(m->horizons, sending, b->rules, b->law + fly_law_limits_max_tilt_rad, &period_s, m->known_rules, m->horizons,
             wire);
    else
        memcpy(wire, setpoint, sizeof wire);
    row[10] = differ(wire, m->wire);
    memcpy(m->wire, wire, sizeof wire);
    memcpy(m->last, setpoint, sizeof setpoint);
}

static void drive(struct memory *m, const struct batch *b, int64_t s)
{
    const struct flight *one = b->first;
    const int64_t drawn = 3 * (s / one->block * one->block + one->block - 1 - s % one->block);
    real draw[3], *driven = m->driven;
    memcpy(m->wires[s % RING], m->wire, sizeof m->wire);
    recall(driven + step_driven_q_w_flu_wxyz, 4, m->wires[0], 5, s - b->attitude_delay, b);
    recall(driven + step_driven_signal, 1, m->wires[0] + 4, 5, s - b->thrust_delay, b);
    take(draw, 3, b->gusts + drawn * (int64_t)sizeof(double));
    memcpy(driven + step_driven_turn, m->turns[s % RING], 4 * sizeof(real));
    for (int axis = 0; axis < 3; axis++) {
        const real fresh = draw[axis] * b->noise_fresh[axis];
        m->gust[axis] = s == 0 ? fresh : fresh + b->noise_keep * m->gust[axis];
        driven[step_driven_force_ned_n + axis] = (m->gust[axis] + one->steady[3 * s + axis]) * b->force_scale;
    }
    if (one->arms) {
        for (int i = 0; i < 12; i++)
            driven[step_driven_moving + i] = spread(one->arms[12 * s + i]);
        driven[step_driven_carried] = spread(1.0);
        if (s == 0)
            memcpy(m->airframe + step_before_rate_before, m->airframe + 10, 3 * sizeof(real));
    }
    step(m->airframe, driven, b->carrier, m->airframe);
    remember_pose(m, b, s + 1);
}

static void fill(struct batch *b, const struct flight *flights, int64_t count)
{
    b->first = flights;
    b->alike = 1;
    for (int lane = 0; lane < LANES; lane++) {
        const struct flight *f = b->flights[lane] = flights + (lane < count ? lane : 0);
        b->alike &= f->ahead == flights->ahead;
        b->mocap_delay[lane] = f->mocap_delay, b->attitude_delay[lane] = f->attitude_delay;
        b->thrust_delay[lane] = f->thrust_delay, b->report_delay[lane] = f->report_delay;
        b->looks[lane] = (intptr_t)f->looks, b->gusts[lane] = (intptr_t)f->gusts;
        b->errors[lane] = (intptr_t)f->errors, b->ahead[lane] = (intptr_t)f->ahead, b->known[lane] = (intptr_t)f->known;
        b->lanes[lane] = lane * (int64_t)sizeof(double);
    }
    EVERY(b->params, estimate_params_size, f->params[i])
    EVERY(b->law, fly_law_size, f->law[i])
    EVERY(b->rules, send_rules_size, f->rules[i])
    EVERY(b->carrier, step_carrier_size, f->carrier[i])
    EVERY(&b->report_age_s, 1, f->report_age_s)
    EVERY(&b->force_scale, 1, f->force_scale)
    EVERY(&b->noise_keep, 1, f->noise_keep)
    EVERY(b->noise_fresh, 3, f->noise_fresh[i])
    EVERY(b->look_noise, 2, f->look_noise[i])
}

static void begin(struct memory *m, const struct batch *b)
{
    const real period_s = spread(b->first->period_s);
    memset(m, 0, sizeof *m);
    EVERY(m->airframe, step_before_size, f->airframe[i])
    for (int step = 0; step < RING; step++) {
        m->turns[step][0] = spread(1.0);
        EVERY(m->wires[step], 4, f->first_q[i])
        EVERY(m->wires[step] + 4, 1, f->first_signal)
    }
    m->horizons[send_before_horizon_unseen_s] = m->horizons[send_before_held_unseen_s] = spread(INFINITY);
    m->horizons[send_before_turn_w] = spread(1.0);
    EVERY(m->last, 5, f->first_setpoint[i])
    EVERY(m->wire, 5, f->first_setpoint[i])
    fly_known(b->law, &period_s, m->known_law);
    send_known(b->rules, b->law + fly_law_limits_max_tilt_rad, &period_s, m->known_rules);
}

int64_t width(void) { return WIDTH; }

/* Fly up to WIDTH vehicles that differ in nothing but what a lane has of its own: no cycles, arms or steady force. */
void fly_vehicles(const struct flight *flights, int64_t count)
{
    struct batch b;
    struct memory m;
    fill(&b, flights, count);
    begin(&m, &b);
    remember_pose(&m, &b, 0);
    for (int64_t cycle = 0; cycle < flights->cycles; cycle++) {
        const int64_t first = cycle * flights->steps_per_cycle;
        real row[ROW];
        see(&m, &b, cycle, first);
        for (int axis = 0; axis < 3; axis++) {
            row[axis] = axis ? -m.airframe[axis] : m.airframe[0];
            row[3 + axis] = axis ? -m.airframe[3 + axis] : m.airframe[3];
        }
        control(&m, &b, cycle, first, row);
        for (int lane = 0; lane < count; lane++)
            for (int i = 0; i < ROW; i++)
                flights[lane].rows[flights->cycles * i + cycle] = row[i][lane];
        for (int64_t s = first; s < first + flights->steps_per_cycle; s++)
            drive(&m, &b, s);
    }
}

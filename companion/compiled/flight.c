/* Flights in virtual time: the loop around the traced functions of traced.c, as simulation/simulation.py runs it. */

#include "flight.h"

/* As geometry/array_math.py has them: NaN if either is NaN. */
static inline double larger(double a, double b) { return a >= b || a != a ? a : b; }
static inline double smaller(double a, double b) { return a <= b || a != a ? a : b; }

/* One vehicle in the words of traced.c. */
typedef double real;
typedef int truth;
#define NUMBER(x) (x)
#define COUNT(condition) ((double)(condition))
#define CHOICE(condition, a, b) ((condition) ? (a) : (b))
#define IF(condition) if (condition)
#define ELSE(condition) else
#define OTHER(condition, before, x) (x)

#include "traced.c"

/* The most vehicles side by side that this computer has instructions for: batch.c. */
int64_t lanes(void)
{
#ifdef __x86_64__
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl"))
        return 8;
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        return 4;
#endif
    return 1;
}

struct memory {
    double airframe[step_before_size], filters[estimate_before_size], held[fly_memory_size];
    double horizons[send_before_size], last[5], wire[5], pose[estimate_pose_size], gust[3];
    double poses[RING][7], turns[RING][4], wires[RING][5];
    double known_law[fly_known_size], known_rules[send_known_size];
    double stamp_s;
};

static void remember_pose(struct memory *m, const struct flight *f, int64_t step)
{
    const double *state = m->airframe, at = step * f->step_s * f->sample_hz;
    memcpy(m->poses[step % RING], state, 3 * sizeof(double));
    memcpy(m->poses[step % RING] + 3, state + 6, 4 * sizeof(double));
    if (f->errors) {
        const int64_t first = (int64_t)at;
        const double share = at - first;
        horizon_turn(f->errors + 2 * first, &share, m->turns[step % RING]);
    }
}

/* Take the frame of this cycle; 0 where its verdict is left to the estimator of the flight. */
static int see(struct memory *m, const struct flight *f, int64_t cycle, int64_t step)
{
    double measured[look_measured_size], accepted = 1.0;
    const double now_s = cycle * f->period_s;
    if (cycle > 0 && f->unseen && f->unseen[cycle])
        return 1;
    look(m->poses[(step > f->mocap_delay ? step - f->mocap_delay : 0) % RING], f->looks + 6 * cycle, f->look_noise,
         measured);
    if (cycle == 0) {
        begin_estimate(measured, f->params, m->filters);
    } else {
        const double dt_s = now_s - m->stamp_s, room_m = 0.999 * f->params[estimate_params_room_m];
        const double far = measured[0] * measured[0] + measured[1] * measured[1] + measured[2] * measured[2];
        const int repeats = memcmp(measured, m->pose, sizeof measured) == 0 && f->params[estimate_params_drop_repeats];
        estimate(m->filters, measured, &dt_s, f->params, m->filters, &accepted);
        if (f->strict && !(accepted && !repeats && far < room_m * room_m && dt_s < f->params[estimate_params_max_gap_s]))
            return 0;
    }
    memcpy(m->pose, measured, sizeof measured);
    m->stamp_s = now_s;
    return 1;
}

static void place_state(double *to, const double *filters)
{
    to[0] = 0.0;
    memcpy(to + fly_given_state_position_w_m, filters + estimate_before_motion_position, 3 * sizeof(double));
    memcpy(to + fly_given_state_velocity_w_mps, filters + estimate_before_motion_velocity, 3 * sizeof(double));
    memcpy(to + fly_given_state_q_w_flu_wxyz, filters + estimate_before_attitude_q, 4 * sizeof(double));
    memcpy(to + fly_given_state_rate_flu_radps, filters + estimate_before_attitude_rate, 3 * sizeof(double));
}

static int differ(const double *a, const double *b)
{
    for (int i = 0; i < 5; i++)
        if (!(a[i] == b[i]))
            return 1;
    return 0;
}

static void believed(const struct memory *m, const struct flight *f, int64_t step, double *q)
{
    const int64_t then = (step > f->report_delay ? step - f->report_delay : 0) % RING;
    const double *true_q = m->poses[then] + 3;
    if (f->errors)
        report(true_q, m->turns[then], q);
    else
        q[0] = true_q[0], q[1] = true_q[1], q[2] = -true_q[2], q[3] = -true_q[3];
}

static void control(struct memory *m, const struct flight *f, int64_t cycle, int64_t step, double *row)
{
    double given[fly_given_size] = {0.0}, sending[send_given_size], setpoint[fly_setpoint_size], wire[5];
    const double age_s = cycle * f->period_s - (m->stamp_s + 0.0 - f->params[estimate_params_delay_s]);
    place_state(given, m->filters);
    given[fly_given_age_s] = age_s;
    memcpy(given + fly_given_ahead_position_w_m, f->ahead + 10 * cycle, 10 * sizeof(double));
    memcpy(given + fly_given_last_q_w_flu_wxyz, m->last, 5 * sizeof(double));
    if (f->known)
        memcpy(given + fly_given_known_accel_b_mps2, f->known + 3 * cycle, 3 * sizeof(double));
    if (cycle == 0)
        begin_law(given, f->law, &f->period_s, f->network, m->held);
    fly(m->held, given, f->law, &f->period_s, m->known_law, m->held, setpoint, row + 6);
    memcpy(sending, setpoint, sizeof setpoint);
    sending[send_given_is_new] = differ(setpoint, m->last);
    memcpy(sending + send_given_last_q_w_flu_wxyz, m->wire, 5 * sizeof(double));
    place_state(sending + send_given_state_time_s, m->filters);
    sending[send_given_age_s] = age_s;
    believed(m, f, step, sending + send_given_autopilot_q_w_flu_wxyz);
    sending[send_given_autopilot_age_s] = f->report_age_s;
    if (f->corrects)
        send(m->horizons, sending, f->rules, f->law + fly_law_limits_max_tilt_rad, &f->period_s, m->known_rules, m->horizons,
             wire);
    else
        memcpy(wire, setpoint, sizeof wire);
    row[10] = differ(wire, m->wire);
    memcpy(m->wire, wire, sizeof wire);
    memcpy(m->last, setpoint, sizeof setpoint);
    memcpy(m->wires[cycle % RING], wire, sizeof wire);
}

static void drive(struct memory *m, const struct flight *f, int64_t s)
{
    double driven[step_driven_size] = {0.0};
    const int64_t q_at = s - f->attitude_delay, thrust_at = s - f->thrust_delay;
    const double *draw = f->gusts + 3 * (s / f->block * f->block + f->block - 1 - s % f->block);
    const double *q = q_at < 0 ? f->first_q : m->wires[q_at / f->steps_per_cycle % RING];
    memcpy(driven + step_driven_q_w_flu_wxyz, q, 4 * sizeof(double));
    driven[step_driven_signal] = thrust_at < 0 ? f->first_signal : m->wires[thrust_at / f->steps_per_cycle % RING][4];
    memcpy(driven + step_driven_turn, m->turns[s % RING], 4 * sizeof(double));
    for (int axis = 0; axis < 3; axis++) {
        const double fresh = draw[axis] * f->noise_fresh[axis];
        m->gust[axis] = s == 0 ? fresh : fresh + f->noise_keep * m->gust[axis];
        driven[step_driven_force_ned_n + axis] = (m->gust[axis] + f->steady[3 * s + axis]) * f->force_scale;
    }
    if (f->arms) {
        memcpy(driven + step_driven_moving, f->arms + 12 * s, 12 * sizeof(double));
        driven[step_driven_carried] = 1.0;
        if (s == 0)
            memcpy(m->airframe + step_before_rate_before, m->airframe + 10, 3 * sizeof(double));
    }
    step(m->airframe, driven, f->carrier, m->airframe);
    remember_pose(m, f, s + 1);
}

/* The walk of an autopilot's horizon, (samples, 2): each sample is what the one before left of it, and a draw. */
void walk(double *errors, int64_t samples, double keep, double fresh, const double *first, const double *draws)
{
    double now[2] = {first[0], first[1]};
    for (int64_t i = 0; i < samples; i++)
        for (int axis = 0; axis < 2; axis++) {
            errors[2 * i + axis] = now[axis];
            now[axis] = keep * now[axis] + fresh * draws[2 * i + axis];
        }
}

/* Fly one vehicle; returns the number of cycles flown, fewer than asked where one is left to Python. */
int64_t fly_vehicle(const struct flight *f)
{
    struct memory m;
    memset(&m, 0, sizeof m);
    memcpy(m.airframe, f->airframe, sizeof m.airframe);
    for (int i = 0; i < RING; i++)
        m.turns[i][0] = 1.0;
    m.horizons[send_before_horizon_unseen_s] = m.horizons[send_before_held_unseen_s] = INFINITY;
    m.horizons[send_before_turn_w] = 1.0;
    memcpy(m.last, f->first_setpoint, sizeof m.last);
    memcpy(m.wire, f->first_setpoint, sizeof m.wire);
    fly_known(f->law, &f->period_s, m.known_law);
    send_known(f->rules, f->law + fly_law_limits_max_tilt_rad, &f->period_s, m.known_rules);
    remember_pose(&m, f, 0);
    for (int64_t cycle = 0; cycle < f->cycles; cycle++) {
        const int64_t first = cycle * f->steps_per_cycle;
        double row[ROW];
        if (!see(&m, f, cycle, first))
            return cycle;
        for (int axis = 0; axis < 3; axis++) {
            row[axis] = axis ? -m.airframe[axis] : m.airframe[0];
            row[3 + axis] = axis ? -m.airframe[3 + axis] : m.airframe[3];
        }
        control(&m, f, cycle, first, row);
        for (int i = 0; i < ROW; i++)
            f->rows[f->cycles * i + cycle] = row[i];
        for (int64_t s = first; s < first + f->steps_per_cycle; s++)
            drive(&m, f, s);
    }
    return f->cycles;
}

/* Drive eight servos to goals (m, 8), the servos' own angles, each due at its step. They begin `settle` steps before step 0 at
   rest at the first goal. Gives their angles at step 0 and after each of `count` steps, (count + 1, 8). */
void drive_servos(const double *servos, const double *assembly, const double *goals, const int64_t *due, int64_t m,
                  int64_t settle, int64_t count, double dt_s, double *angles)
{
    double now[weigh_angle_rad_size][turn_before_size], angle[weigh_angle_rad_size], load_nm[weigh_load_nm_size];
    const double *goal = goals;
    int64_t next = 0;
    for (int i = 0; i < weigh_angle_rad_size; i++)
        now[i][0] = angle[i] = goals[i], now[i][1] = 0.0;
    for (int64_t step = -settle; step < count; step++) {
        if (step == 0)
            memcpy(angles, angle, sizeof angle);
        for (; next < m && due[next] <= step; next++)
            goal = goals + weigh_angle_rad_size * next;
        weigh(angle, assembly, load_nm);
        for (int i = 0; i < weigh_angle_rad_size; i++) {
            turn(now[i], goal + i, load_nm + i, servos + turn_servo_size * i, &dt_s, now[i]);
            angle[i] = now[i][0];
        }
        if (step >= 0)
            memcpy(angles + weigh_angle_rad_size * (step + 1), angle, sizeof angle);
    }
}

/* For a flight in real time: each takes the addresses of vectors that stay where they are. */

/* The two halves of a cycle: control/compiled/pipeline.py. */
const int pilot_sizes[] = {pilot_memory_size, pilot_given_size, pilot_law_size, pilot_known_size, pilot_out_size, pilot_halfway_size};

enum { MEMORY, GIVEN, LAW, KNOWN, OUT, HALFWAY, F_HAT };

void pilot_prepare(double *const *v) { pilot_known(v[LAW], v[KNOWN]); }

void pilot_decide(double *const *v) { pilot(v[MEMORY], v[GIVEN], v[LAW], v[KNOWN], v[MEMORY], v[OUT], v[HALFWAY]); }

void pilot_settle(double *const *v)
{
    settle(v[MEMORY] + pilot_memory_law_filter_chi, v[HALFWAY], v[LAW] + pilot_law_gains_c1, v[MEMORY] + pilot_memory_law_filter_chi,
           v[F_HAT]);
}

/* Correct the autopilot's horizon: control/compiled/wire.py. State, given, rules and limits, out. */
void wire_put(double *const *v) { wire(v[0], v[1], v[2], v[2] + wire_rules_size, v[0], v[3]); }

/* Take a frame; 0, and nothing is changed, where it is not a usual one: estimation/frame_estimator.py. Memory, frame, parameters, state. */
int take_frame(double *const *v)
{
    double after[follow_after_size], usual;
    follow(v[0], v[1], v[2], after, &usual, v[3]);
    if (usual == 0.0)
        return 0;
    memcpy(v[0], after, sizeof after);
    return 1;
}

/* Whole cycles of the law for vehicles (count,) with the same gains; rows of memory, which is replaced, inputs and outputs. */
void law_step_each(int64_t count, double *memory, const double *now, const double *gains, const double *lookahead,
                   double *output)
{
    enum { Y2 = 10, ALPHA1 = 13 }; /* in the output of traces.py: decide */
    for (int64_t i = 0; i < count; i++) {
        double halfway[settle_halfway_size], f_hat[settle_f_hat_size];
        double *m = memory + decide_memory_size * i, *y = output + decide_output_size * i;
        const double *x = now + decide_now_size * i;
        decide(m, x, gains, lookahead, m, y);
        memcpy(halfway + settle_halfway_alpha1, y + ALPHA1, 3 * sizeof(double));
        memcpy(halfway + settle_halfway_y2, y + Y2, 3 * sizeof(double));
        memcpy(halfway + settle_halfway_velocity_ref, x + decide_now_reference_velocity_w_mps, 3 * sizeof(double));
        memcpy(halfway + settle_halfway_acceleration_ref, x + decide_now_reference_acceleration_w_mps2, 3 * sizeof(double));
        halfway[settle_halfway_dt_s] = x[decide_now_dt_s];
        settle(m, halfway, gains, m, f_hat);
    }
}

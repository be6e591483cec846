/* The driveline behind both versions of FMI: values by reference, ticks, and what is refused.
   Everything is static, so that several FMUs may be linked into one program. */
#ifndef TCC_MODEL_H
#define TCC_MODEL_H

/* The same bits need every product rounded before it is added. Clang and others heed the pragma of the standard; GCC
   knows it from no version on, and fuses where the processor can unless it is told otherwise, which its own pragma
   does. What rounds differently altogether is refused. */
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize ("fp-contract=off")
#elif defined(_MSC_VER) && !defined(__clang__)
#pragma fp_contract (off)
#else
#pragma STDC FP_CONTRACT OFF
#endif
#ifdef __FAST_MATH__
#error "-ffast-math changes the results of this model; compile it without"
#endif

#include <float.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
/* 16: only _Float16 is evaluated as such, which processors with AVX512-FP16 have. */
#if FLT_EVAL_METHOD != 0 && FLT_EVAL_METHOD != 16
#error "this model needs double arithmetic that is rounded to double (on x86: -msse2 -mfpmath=sse)"
#endif
#include "tcc_variables.h"
#include "tcc_kernel.h"

/* Sub-steps of one communication step, some ten seconds of a processor, and ticks in all: time is still exact there. */
#define TCC_MOST_SUBSTEPS 1e8
#define TCC_MOST_TICKS 9000000000000000LL

typedef enum { TCC_OK, TCC_DISCARD, TCC_ERROR } tcc_answer;
typedef enum { TCC_INSTANTIATED, TCC_INITIALIZATION, TCC_STEP_MODE, TCC_TERMINATED } tcc_mode;

/* Where the phase is counted from, after the frequency or the pressure's ratio to it were changed: phi at a time, and by how
   much the load's angle is ahead of r phi + psi. */
typedef struct { double time, phase, lead; } tcc_origin;

/* The actuator's pressure, the angle of the shaft's far end, and the commands that wait out the actuator's dead time. */
typedef struct { double pressure, far_angle, waiting[TCC_DELAY_TICKS + 1]; } tcc_around;

typedef struct {
    double x[TCC_VARIABLES];       /* every variable, by its reference */
    double state[4];               /* slip speed, plate angle, plate speed, flywheel angle */
    double start_time, stick_speed;
    double expected;               /* the communication point that comes next, as the importer counts */
    long long tick;
    Terms terms;
    tcc_origin origin;
    double frequency, ratio;       /* engine.frequency and pressure.frequency_ratio of the terms */
    tcc_around around;
    int substeps, mode, changed;   /* changed: terms are to be worked out anew */
    int started;                   /* flags of the terms at the start, as tcc_flags gives them */
} tcc_model;

typedef struct { tcc_model model; char said[400]; } tcc_plant;

/* Say why, for the logger, and give the answer back. */
static tcc_answer tcc_say(tcc_plant *p, tcc_answer answer, const char *format, ...)
{
    va_list words;
    va_start(words, format);
    vsnprintf(p->said, sizeof p->said, format, words);
    va_end(words);
    return answer;
}

static void tcc_reset(tcc_plant *p)
{
    memset(p, 0, sizeof *p);
    for (int k = 0; k < TCC_VARIABLES; k++) p->model.x[k] = tcc_variables[k].start;
    p->model.changed = 1;
}

static int tcc_flags(const Terms *t)
{
    return t->torque.has | t->harmonics.has << 1 | t->pulsation.has << 2 | t->stribeck.has << 3 | t->profile.has << 4
        | tcc_linear_flags(&t->linear) << 5;
}

/* A friction table was fitted when this was written: constant and pairs of amplitude over it and rate do not change. */
static double tcc_kinetic(const double *x)
{
#if TCC_TABLE
    (void)x;
    return TCC_KINETIC;
#else
    return x[at_friction_kinetic_coefficient];
#endif
}

static double tcc_per_pressure(const double *x)
{
    return tcc_kinetic(x) * x[at_clutch_area] * x[at_clutch_radius];
}

/* The exponentials of the friction law; none where the coefficient is constant. */
static void tcc_exponentials(const double *x, Terms *t)
{
#if TCC_TABLE
    (void)x;
    t->stribeck.has = TCC_EXPONENTIALS > 0;
    if (t->stribeck.has) memcpy(&t->stribeck._0, tcc_pairs, sizeof tcc_pairs);
#else
    double ratio = x[at_friction_static_coefficient] / tcc_kinetic(x);
    (void)tcc_pairs;
    if (ratio != 1.0) {
        t->stribeck.has = 1;
        t->stribeck._0 = ratio - 1.0;
        t->stribeck._1 = x[at_friction_decay];
    }
#endif
}

/* Columns of a profile: tcc_sim.model.profile. Those behind, four for each harmonic whose amplitude varies, begin with
   TCC_FIRST_SWELL: number of the harmonic, phase, amplitude and its change in a second. */
enum { TCC_AT, TCC_PHASE, TCC_FREQUENCY, TCC_FREQUENCY_RATE, TCC_TORQUE, TCC_TORQUE_RATE, TCC_LOAD, TCC_LOAD_RATE };
#define TCC_SWELL 4
#define TCC_FIRST_SWELL (TCC_PROFILE_COLUMNS - TCC_SWELL * TCC_SWELLS)

/* Value and change in a second at time t of n points, whose values are `apart` places apart, or of a constant where there
   are none. */
static void tcc_line(const double *x, int n, int times, int values, int apart, int constant, double t, double found[2])
{
    int k = n > 0 ? searched(x + times, 1, n, t) - 1 : 0;
    found[0] = x[constant];
    found[1] = 0.0;
    if (n == 0) return;
    if (k < 0) k = 0;
    if (k < n - 1) found[1] = (x[values + (k + 1) * apart] - x[values + k * apart]) / (x[times + k + 1] - x[times + k]);
    found[0] = x[values + k * apart] + found[1] * (t - x[times + k]);
}

#if TCC_SWELLS > 0
/* The columns of a harmonic whose amplitude varies; one that stays 0 has the number 0. */
static void tcc_swell(const double *x, int number, double phase, int n, int times, int values, int apart, double t,
                      double found[TCC_SWELL])
{
    found[0] = 0.0;
    for (int k = 0; k < n; k++) if (x[values + k * apart] != 0.0) found[0] = number;
    found[1] = phase;
    tcc_line(x, n, times, values, apart, 0, t, found + 2);
}
#endif

/* Add the times of n points to those that are sorted already, each once. */
static int tcc_merge(double *sorted, int count, const double *times, int n)
{
    for (int k = 0; k < n; k++) {
        int place = searched(sorted, 1, count, times[k]);
        if (place > 0 && sorted[place - 1] == times[k]) continue;
        memmove(sorted + place + 1, sorted + place, (size_t)(count - place) * sizeof *sorted);
        sorted[place] = times[k];
        count++;
    }
    return count;
}

/* The profiles of the scene's keys as one, from an origin on; its loads are pressures. A profile of the frequency counts from 0. */
static void tcc_profile_of(const double *x, double frequency, tcc_origin origin, Terms *t)
{
    double times[TCC_MOST_PIECES + 1] = {0.0}, gained = 0.0;
    int n = 1, late;
    if (TCC_FREQUENCY_POINTS > 0) origin.time = origin.phase = 0.0;
    n = tcc_merge(times, n, x + at_engine_frequency_times, TCC_FREQUENCY_POINTS);
    n = tcc_merge(times, n, x + at_engine_mean_torque_times, TCC_TORQUE_POINTS);
    n = tcc_merge(times, n, x + at_pressure_mean_times, TCC_PRESSURE_POINTS);
    if (TCC_SWELLS > 0) {
        n = tcc_merge(times, n, x + at_engine_torque_amplitude_times, TCC_AMPLITUDE_POINTS);
        n = tcc_merge(times, n, x + at_engine_harmonic_amplitudes_times, TCC_HARMONIC_POINTS);
    }
    late = searched(times, 1, n, origin.time) - 1;   /* the points before the origin count no more */
    times[late] = origin.time;
    n -= late;
    t->profile.has = 1;
    t->profile.rows = n;
    for (int k = 0; k < n; k++) {
        double *row = t->profile.at[k], now = times[late + k];
        row[TCC_AT] = now;
        tcc_line(x, TCC_FREQUENCY_POINTS, at_engine_frequency_times, at_engine_frequency_values, 1, at_engine_frequency,
                 now, row + TCC_FREQUENCY);
        if (TCC_FREQUENCY_POINTS == 0) row[TCC_FREQUENCY] = frequency;
        tcc_line(x, TCC_TORQUE_POINTS, at_engine_mean_torque_times, at_engine_mean_torque_values, 1,
                 at_engine_mean_torque, now, row + TCC_TORQUE);
        tcc_line(x, TCC_PRESSURE_POINTS, at_pressure_mean_times, at_pressure_mean_values, 1, at_pressure_mean, now,
                 row + TCC_LOAD);
#if TCC_SWELLS > 0
        double *swell = row + TCC_FIRST_SWELL;
        if (TCC_AMPLITUDE_POINTS > 0) {
            tcc_swell(x, 1, 0.0, TCC_AMPLITUDE_POINTS, at_engine_torque_amplitude_times, at_engine_torque_amplitude_values,
                      1, now, swell);
            swell += TCC_SWELL;
        }
        for (int j = 0; TCC_HARMONIC_POINTS > 0 && j < TCC_HARMONICS; j++, swell += TCC_SWELL)
            tcc_swell(x, j + 2, x[at_engine_harmonic_phases + j], TCC_HARMONIC_POINTS, at_engine_harmonic_amplitudes_times,
                      at_engine_harmonic_amplitudes_values + j, TCC_HARMONICS, now, swell);
#endif
        row[TCC_PHASE] = origin.phase + gained;
        if (k < n - 1) {
            double step = times[late + k + 1] - now;
            gained += step * (row[TCC_FREQUENCY] + 0.5 * row[TCC_FREQUENCY_RATE] * step);
        }
    }
}

/* Where the phases are counted from with new values, so that neither that of the engine nor the load's jumps now. */
static tcc_origin tcc_moved(const tcc_model *m, Terms *room)
{
    double now = (double)m->tick * TCC_STEP, frequency = m->x[at_engine_frequency], ratio = m->x[at_pressure_frequency_ratio];
    tcc_origin origin = m->origin;
    double phase;
    if (TCC_FREQUENCY_POINTS > 0) frequency = m->frequency;
    if (m->mode != TCC_STEP_MODE || (frequency == m->frequency && ratio == m->ratio)) return origin;
    tcc_profile_of(m->x, m->frequency, origin, room);
    phase = tcc_reached(now, room->profile.at[tcc_piece_at(&room->profile, now)])._0;
    origin.lead += (m->ratio - ratio) * phase;
    if (frequency != m->frequency) {
        origin.time = now;
        origin.phase = phase;
    }
    return origin;
}

/* The terms that the scene needs with these values, with or without a profile. */
static void tcc_terms_of(const double *x, int profile, tcc_origin origin, Terms *t)
{
    double omega = profile ? 1.0 : x[at_engine_frequency], per_pressure = tcc_per_pressure(x);
    memset(t, 0, sizeof *t);
    tcc_linear_of(x, &t->linear);
    t->mean_torque = x[at_engine_mean_torque];
    if (TCC_ENGINE_HARMONIC && TCC_AMPLITUDE_POINTS == 0 && x[at_engine_torque_amplitude] > 0.0) {
        t->torque.has = 1;
        t->torque._0 = x[at_engine_torque_amplitude];
        t->torque._1 = omega;
    }
    for (int k = 0; TCC_ENGINE_HARMONIC && TCC_HARMONIC_POINTS == 0 && k < TCC_HARMONICS; k++) {
        double amplitude = x[at_engine_harmonic_amplitudes + k], *row = t->harmonics.at[t->harmonics.rows];
        if (amplitude > 0.0) {
            row[0] = (k + 2) * omega;
            row[1] = amplitude;
            row[2] = x[at_engine_harmonic_phases + k];
            t->harmonics.has = 1;
            t->harmonics.rows++;
        }
    }
    t->mean_load = per_pressure * x[at_pressure_mean];
    if (TCC_PRESSURE_HARMONIC && x[at_pressure_amplitude] > 0.0) {
        t->pulsation.has = 1;
        t->pulsation._0 = per_pressure * x[at_pressure_amplitude];
        t->pulsation._1 = x[at_pressure_frequency_ratio] * omega;
        t->pulsation._2 = x[at_pressure_phase] + origin.lead;
    }
    t->smoothing = x[at_friction_smoothing];
    tcc_exponentials(x, t);
    if (!profile) return;
    tcc_profile_of(x, x[at_engine_frequency], origin, t);
    for (int k = 0; k < t->profile.rows; k++) {
        t->profile.at[k][TCC_LOAD] *= per_pressure;
        t->profile.at[k][TCC_LOAD_RATE] *= per_pressure;
    }
}

/* The same with every term there, absent ones of zero amplitude: what the node runs once other terms are needed than at
   the start. */
static void tcc_general_terms(const double *x, tcc_origin origin, Terms *t)
{
    tcc_terms_of(x, 1, origin, t);
    if (!t->torque.has) t->torque._1 = 1.0;
    if (!t->harmonics.has) {
        t->harmonics.rows = 1;
        t->harmonics.at[0][0] = 2.0;
    }
    if (!t->pulsation.has) t->pulsation._1 = 1.0;
    if (!t->stribeck.has) t->stribeck._1 = x[at_friction_decay];
    t->torque.has = t->harmonics.has = t->pulsation.has = t->stribeck.has = 1;
}

/* Inputs take the place of the scene's own excitation, whose terms stay with zero amplitude. */
static void tcc_hold(const double *x, Terms *t)
{
    (void)x; (void)t;
#if TCC_ENGINE_TOPIC
    t->mean_torque = x[at_engine_torque];
    t->torque._0 = 0.0;
    for (int k = 0; k < t->harmonics.rows; k++) t->harmonics.at[k][1] *= 0.0;
    for (int k = 0; k < t->profile.rows; k++) {
        t->profile.at[k][TCC_TORQUE] = t->mean_torque;
        t->profile.at[k][TCC_TORQUE_RATE] = 0.0;
        for (int j = TCC_FIRST_SWELL; j < TCC_PROFILE_COLUMNS; j += TCC_SWELL)
            t->profile.at[k][j + 2] = t->profile.at[k][j + 3] = 0.0;
    }
#endif
#if TCC_PRESSURE_TOPIC
    t->mean_load = tcc_per_pressure(x) * x[at_actuation_pressure];
    t->pulsation._0 = 0.0;
    for (int k = 0; k < t->profile.rows; k++) {
        t->profile.at[k][TCC_LOAD] = t->mean_load;
        t->profile.at[k][TCC_LOAD_RATE] = 0.0;
    }
#endif
}

/* Sub-steps of a tick; a number, since it may be beyond every limit. */
static double tcc_substeps(const Terms *t)
{
    double fastest = sqrt(t->linear.stiffness / t->linear.plate), excitation = 0.0, frequency = 0.0, load = 0.0, needed, beta, peak;
    if (t->torque.has) excitation = fmax(excitation, t->torque._1);
    if (t->pulsation.has) excitation = fmax(excitation, t->pulsation._1);
    for (int k = 0; k < t->harmonics.rows; k++) excitation = fmax(excitation, t->harmonics.at[k][0]);
    for (int j = TCC_FIRST_SWELL; t->profile.has && j < TCC_PROFILE_COLUMNS; j += TCC_SWELL)
        excitation = fmax(excitation, t->profile.at[0][j]);
    for (int k = 0; k < t->profile.rows; k++) {
        frequency = fmax(frequency, t->profile.at[k][TCC_FREQUENCY]);
        load = fmax(load, t->profile.at[k][TCC_LOAD]);
    }
    if (t->profile.has) excitation *= frequency;
    needed = TCC_STEP * fmax(fastest, excitation) / TCC_RESOLUTION;
    if (t->stribeck.has) {
        beta = 1.0 / t->linear.flywheel + 1.0 / t->linear.plate;
        peak = (t->profile.has ? load : t->mean_load) + (t->pulsation.has ? fabs(t->pulsation._0) : 0.0);
#if TCC_TABLE
        needed = fmax(needed, 2.0 * TCC_STEP * beta * peak * TCC_STEEPEST_FALL);
#else
        needed = fmax(needed, 2.0 * TCC_STEP * beta * peak * t->stribeck._0 * t->stribeck._1);
#endif
    }
    return fmax(1.0, ceil(needed - 1e-9));
}

/* Above 0 where mubar falls at v > 0: the logarithm of what lets it fall over what lets it rise. */
static double tcc_fall(double v, double sigma, double excess, double decay)
{
    double push = decay * v - log(excess);
    double rising = log(4.0 * sigma / decay) + fmax(push, 0.0) + log1p(exp(-fabs(push)));
    return 2.0 * sigma * v + log(-expm1(-4.0 * sigma * v)) - rising;
}

/* Whether v lies behind the place where the two sides come nearest: cosh(2 sigma v) = exp(alpha v)/(r - 1). */
static int tcc_past_nearest(double v, double sigma, double excess, double decay)
{
    double larger = 2.0 * sigma * v;
    return decay * v - log(excess) >= larger + log1p(exp(-2.0 * larger)) - log(2.0);
}

/* Above 0 where a law of several exponentials falls at v > 0: its slope over 1 - tanh^2. */
static double tcc_fall_of_several(double v, double sigma)
{
    double ratio = 1.0, slope = 0.0;
    for (int k = 0; k < 2 * TCC_EXPONENTIALS; k += 2) {
        double share = tcc_pairs[k] * exp(-tcc_pairs[k + 1] * v);
        ratio += share;
        slope -= tcc_pairs[k + 1] * share;
    }
    return -slope * 0.5 * sinh(fmin(2.0 * sigma * v, 600.0)) / sigma - ratio;
}

/* tcc_stick_speed for several exponentials: the first place on a grid from which on mubar falls, by halving. */
static double tcc_stick_speed_of_several(double sigma)
{
    double slowest = tcc_pairs[1], low = 0.0, high, middle, first = 1e-4 / sigma, last;
    const int n = 20000;
    for (int k = 3; k < 2 * TCC_EXPONENTIALS; k += 2) slowest = fmin(slowest, tcc_pairs[k]);
    last = 40.0 / sigma + 40.0 / slowest;
    for (int k = 0; k < n; k++) {
        high = first * pow(last / first, k / (n - 1.0));
        if (tcc_fall_of_several(high, sigma) > 0.0) {
            while (low < (middle = 0.5 * (low + high)) && middle < high) {
                if (tcc_fall_of_several(middle, sigma) > 0.0) high = middle; else low = middle;
            }
            return high;
        }
        low = high;
    }
    return atanh(0.99) / sigma;
}

/* Slip speed at or below which the law counts as stick: where mubar peaks, or where tanh is 0.99. */
static double tcc_stick_speed(const Terms *t)
{
    double sigma = t->smoothing, excess = t->stribeck._0, decay = t->stribeck._1, low = 0.0, high, middle;
    if (TCC_EXPONENTIALS > 1) return tcc_stick_speed_of_several(sigma);
    if (!t->stribeck.has || decay == 0.0 || excess <= 0.0) return atanh(0.99) / sigma;
    high = 20.0 / sigma + (log(sigma + decay) - log(decay)) / sigma;
    if (!(tcc_fall(high, sigma, excess, decay) > 0.0)) {
        if (decay <= 2.0 * sigma || excess <= 1.0) return atanh(0.99) / sigma;
        high = log(excess) / (decay - 2.0 * sigma);
        while (low < (middle = 0.5 * (low + high)) && middle < high) {
            if (tcc_past_nearest(middle, sigma, excess, decay)) high = middle; else low = middle;
        }
        if (!(tcc_fall(high, sigma, excess, decay) > 0.0)) return atanh(0.99) / sigma;
        low = 0.0;
    }
    while (low < (middle = 0.5 * (low + high)) && middle < high) {
        if (tcc_fall(middle, sigma, excess, decay) > 0.0) high = middle; else low = middle;
    }
    return high;
}

/* Whether the times of a profile begin with 0 and increase. */
static tcc_answer tcc_increasing(tcc_plant *p, int first, int n)
{
    const double *times = p->model.x + first;
    for (int k = 0; k < n; k++)
        if (k == 0 ? times[0] != 0.0 : !(times[k] > times[k - 1]))
            return tcc_say(p, TCC_DISCARD, "%s is %g s; the first time must be 0 and the others increase",
                           tcc_variables[first + k].name, times[k]);
    return TCC_OK;
}

/* Work out the terms of changed values, all or nothing. */
static tcc_answer tcc_prepare(tcc_plant *p)
{
    tcc_model *m = &p->model;
    const double *x = m->x;
    double fixed = x[at_friction_static_coefficient], sliding = x[at_friction_kinetic_coefficient], needed;
    tcc_origin origin;
    Terms terms;
    int flags, points = TCC_FREQUENCY_POINTS + TCC_TORQUE_POINTS + TCC_PRESSURE_POINTS + TCC_AMPLITUDE_POINTS
        + TCC_HARMONIC_POINTS;
    if (!m->changed) return TCC_OK;
    if (!TCC_TABLE && (sliding < fixed / 20.0 || sliding > fixed * 20.0))
        return tcc_say(p, TCC_DISCARD, "friction.kinetic_coefficient is %g; with friction.static_coefficient %g it must be "
                       "one twentieth of it to twenty times it", sliding, fixed);
    if (tcc_increasing(p, at_engine_frequency_times, TCC_FREQUENCY_POINTS) != TCC_OK
        || tcc_increasing(p, at_engine_mean_torque_times, TCC_TORQUE_POINTS) != TCC_OK
        || tcc_increasing(p, at_pressure_mean_times, TCC_PRESSURE_POINTS) != TCC_OK
        || tcc_increasing(p, at_engine_torque_amplitude_times, TCC_AMPLITUDE_POINTS) != TCC_OK
        || tcc_increasing(p, at_engine_harmonic_amplitudes_times, TCC_HARMONIC_POINTS) != TCC_OK) return TCC_DISCARD;
    origin = tcc_moved(m, &terms);
    tcc_terms_of(x, points > 0 || origin.time != 0.0 || origin.phase != 0.0 || origin.lead != 0.0, origin, &terms);
    flags = tcc_flags(&terms);
    if (m->mode == TCC_STEP_MODE && flags != m->started) tcc_general_terms(x, origin, &terms);
    tcc_hold(x, &terms);
    needed = tcc_substeps(&terms);
    if (!(needed <= TCC_SUBSTEP_LIMIT))
        return tcc_say(p, TCC_DISCARD, "a tick of %g s needs %.0f sub-steps; at most %d are allowed", TCC_STEP, needed,
                       TCC_SUBSTEP_LIMIT);
    m->terms = terms;
    m->origin = origin;
    m->frequency = x[at_engine_frequency];
    m->ratio = x[at_pressure_frequency_ratio];
    m->stick_speed = tcc_stick_speed(&terms);
    m->substeps = (int)needed;
    m->changed = 0;
    if (m->mode != TCC_STEP_MODE) m->started = flags;
    return TCC_OK;
}

/* Whether there is an actuator between the commanded pressure and the plates; tcc_sim.model.actuator. */
static int tcc_lagged(const double *x)
{
    return TCC_PRESSURE_TOPIC && (x[at_pressure_time_constant] > 0.0 || x[at_pressure_rate_limit] > 0.0);
}

static int tcc_actuated(const double *x) { return tcc_lagged(x) || TCC_DELAY_TICKS > 0; }

/* Let the actuator's pressure go from one value to another in the next tick, and give back the sub-steps that it needs. */
static double tcc_press(tcc_model *m, double before, double after)
{
    const double *x = m->x;
    double per_pressure = tcc_per_pressure(x), *row = m->terms.approach.at[0];
    m->terms.approach.has = m->terms.approach.rows = tcc_lagged(x);
    m->terms.mean_load = per_pressure * (tcc_lagged(x) ? fmax(before, after) : after);
    for (int k = 0; k < m->terms.profile.rows; k++) m->terms.profile.at[k][TCC_LOAD] = m->terms.mean_load;
    if (tcc_lagged(x)) {
        tuple_dd way = tcc_approach_between(before, after, x[at_pressure_time_constant], x[at_pressure_rate_limit], TCC_STEP);
        row[0] = (double)m->tick * TCC_STEP;
        row[1] = per_pressure * before;
        row[2] = per_pressure * way._0;
        row[3] = way._1;
    }
    return tcc_substeps(&m->terms);
}

/* The highest pressure that the commands until now lead to. */
static double tcc_highest(const tcc_model *m)
{
    double found = fmax(m->around.pressure, m->x[at_actuation_pressure]);
    for (int k = 0; k < TCC_DELAY_TICKS; k++) found = fmax(found, m->around.waiting[k]);
    return found;
}

/* One tick of the actuator, the far end and the driveline. */
static void tcc_tick(tcc_model *m)
{
    double *x = m->x, *far = m->terms.far.at[0];
    if (tcc_actuated(x)) {
        double command = x[at_actuation_pressure], before = m->around.pressure;
        if (TCC_DELAY_TICKS > 0) {
            double *place = m->around.waiting + m->tick % (TCC_DELAY_TICKS + (TCC_DELAY_TICKS == 0));
            command = *place;
            *place = x[at_actuation_pressure];
        }
        m->around.pressure = tcc_pressure_after(before, command, x[at_pressure_time_constant], x[at_pressure_rate_limit], TCC_STEP);
        m->substeps = (int)tcc_press(m, before, m->around.pressure);
    }
    m->terms.far.has = m->terms.far.rows = x[at_output_speed] != 0.0 || m->around.far_angle != 0.0;
    far[0] = (double)m->tick * TCC_STEP;
    far[1] = m->around.far_angle;
    far[2] = x[at_output_speed];
    tcc_advance(m->state, (double)m->tick * TCC_STEP, TCC_STEP / m->substeps, m->substeps, &m->terms);
    m->around.far_angle += TCC_STEP * x[at_output_speed];
    m->tick++;
}

/* Outputs of the state as it is: torques and pressure are those that act at the end of the tick. */
static void tcc_outputs(tcc_model *m)
{
    double *x = m->x, t = (double)m->tick * TCC_STEP, v = m->state[0];
    const Terms *s = &m->terms;
    int piece = tcc_piece_at(&s->profile, t);
    tuple_dd torques = tcc_torques_now(t, piece, &s->profile, s);
    x[at_time] = m->start_time + t;
    x[at_slip_speed] = v;
    x[at_plate_angle] = m->state[1];
    x[at_plate_speed] = m->state[2];
    x[at_flywheel_angle] = m->state[3];
    x[at_flywheel_speed] = v + m->state[2];
    x[at_applied_engine_torque] = torques._0;
    x[at_friction_torque] = torques._1 * tcc_smoothed_coefficient(v, s->smoothing, s->stribeck);
    x[at_stick_slip_state] = fabs(v) <= m->stick_speed ? 0.0 : v > 0.0 ? 1.0 : -1.0;
    x[at_shaft_torque] = x[at_driveline_damping] * (m->state[2] - x[at_output_speed])
        + x[at_driveline_stiffness] * (m->state[1] - m->around.far_angle);
#if TCC_PRESSURE_TOPIC
    x[at_applied_pressure] = tcc_actuated(x) ? m->around.pressure : x[at_actuation_pressure];
#else
    if (s->profile.has) {
        tuple_ddd now = tcc_reached(t, s->profile.at[piece]);
        x[at_applied_pressure] = fmax(0.0, now._2 / tcc_per_pressure(x) + x[at_pressure_amplitude]
            * sin(x[at_pressure_frequency_ratio] * now._0 + m->origin.lead + x[at_pressure_phase]));
    } else x[at_applied_pressure] = fmax(0.0, x[at_pressure_mean] + x[at_pressure_amplitude]
        * sin(x[at_pressure_frequency_ratio] * (x[at_engine_frequency] * t) + x[at_pressure_phase]));
#endif
}

/* The initial state of the values as they are. */
static tcc_answer tcc_initialise(tcc_plant *p)
{
    tcc_model *m = &p->model;
    tcc_answer answer = tcc_prepare(p);
    if (answer != TCC_OK) return answer;
    m->state[0] = m->x[at_initial_slip_speed];
    m->state[1] = m->state[3] = m->x[at_initial_plate_angle];
    m->state[2] = m->x[at_initial_plate_speed];
    m->tick = 0;
    m->around.far_angle = 0.0;
    if (tcc_actuated(m->x)) {
        m->around.pressure = m->x[at_pressure_mean];
        for (int k = 0; k <= TCC_DELAY_TICKS; k++) m->around.waiting[k] = m->around.pressure;
        tcc_press(m, m->around.pressure, m->around.pressure);
    }
    tcc_outputs(m);
    return TCC_OK;
}

static tcc_answer tcc_enter_initialization(tcc_plant *p, double start_time)
{
    if (p->model.mode != TCC_INSTANTIATED) return tcc_say(p, TCC_ERROR, "initialisation begins once, after a reset");
    if (!isfinite(start_time)) return tcc_say(p, TCC_DISCARD, "the start time is %g; it must be a number", start_time);
    p->model.start_time = p->model.expected = start_time;
    p->model.mode = TCC_INITIALIZATION;
    return TCC_OK;
}

static tcc_answer tcc_exit_initialization(tcc_plant *p)
{
    tcc_answer answer;
    if (p->model.mode != TCC_INITIALIZATION) return tcc_say(p, TCC_ERROR, "it is not being initialised");
    answer = tcc_initialise(p);
    if (answer == TCC_OK) p->model.mode = TCC_STEP_MODE;
    return answer;
}

static tcc_answer tcc_terminate(tcc_plant *p)
{
    if (p->model.mode != TCC_STEP_MODE) return tcc_say(p, TCC_ERROR, "it does not run");
    p->model.mode = TCC_TERMINATED;
    return TCC_OK;
}

/* Whether references are those of variables of a type. */
static tcc_answer tcc_known(tcc_plant *p, const unsigned *references, size_t n, tcc_type type)
{
    if (n && !references) return tcc_say(p, TCC_ERROR, "there are no references");
    for (size_t k = 0; k < n; k++) {
        if (references[k] >= TCC_VARIABLES) return tcc_say(p, TCC_ERROR, "no variable has the reference %u", references[k]);
        if (tcc_variables[references[k]].type != type)
            return tcc_say(p, TCC_ERROR, "%s has another type", tcc_variables[references[k]].name);
    }
    return TCC_OK;
}

/* Make every output readable: while it is being initialised they follow the values. */
static tcc_answer tcc_readable(tcc_plant *p, const unsigned *references, size_t n, tcc_type type)
{
    tcc_answer answer = tcc_known(p, references, n, type);
    if (answer == TCC_OK && p->model.mode == TCC_INITIALIZATION) answer = tcc_initialise(p);
    return answer;
}

/* Whether a value is within the range of a variable. */
static tcc_answer tcc_allowed(tcc_plant *p, const tcc_variable *v, double value)
{
    if (v->role == TCC_CALCULATED || (v->low <= value && value <= v->high && !(v->above && value == v->low))) return TCC_OK;
    return tcc_say(p, TCC_DISCARD, "%s is %g; it must be %s%g to %g", v->name, value, v->above ? "above " : "", v->low,
                   v->high);
}

/* Whether one variable may have a value now. */
static tcc_answer tcc_settable(tcc_plant *p, unsigned reference, double value)
{
    const tcc_variable *v = &tcc_variables[reference];
    int mode = p->model.mode;
    if (v->role == TCC_CALCULATED) return tcc_say(p, TCC_ERROR, "%s is calculated and cannot be set", v->name);
    if (mode == TCC_TERMINATED) return tcc_say(p, TCC_ERROR, "%s cannot be set after the end", v->name);
    if (mode == TCC_STEP_MODE && v->role == TCC_FIXED)
        return tcc_say(p, TCC_ERROR, "%s is fixed; it can be set until the simulation runs", v->name);
    return tcc_allowed(p, v, value);
}

/* Set values, all or none. */
static tcc_answer tcc_set(tcc_plant *p, const unsigned *references, size_t n, const double *values)
{
    tcc_answer answer = tcc_known(p, references, n, TCC_REAL);
    for (size_t k = 0; answer == TCC_OK && k < n; k++) answer = tcc_settable(p, references[k], values[k]);
    for (size_t k = 0; answer == TCC_OK && k < n; k++) {
        if (p->model.x[references[k]] == values[k]) continue;
        p->model.x[references[k]] = values[k];
        p->model.changed = 1;
    }
    return answer;
}

static double tcc_time(const tcc_model *m) { return m->start_time + (double)m->tick * TCC_STEP; }

/* A communication step of whole ticks; one that is refused leaves everything as it was. Importers add up their times, and
   late ones have few digits left: a point is right where the ticks put it, or where the one before and its step do, to the
   rounding of a time of this size. */
static tcc_answer tcc_do_step(tcc_plant *p, double now, double length)
{
    tcc_model *m = &p->model;
    double ticks = floor(length / TCC_STEP + 0.5), before[4], needed, rounding = 4.0 * (nextafter(fabs(now), INFINITY) - fabs(now));
    long long first = m->tick;
    tcc_around around = m->around;
    tcc_answer answer;
    if (m->mode != TCC_STEP_MODE) return tcc_say(p, TCC_ERROR, "a step needs a simulation that runs");
    if (!(ticks >= 1.0) || !(fabs(length - ticks * TCC_STEP) <= fmin(fmax(1e-4 * TCC_STEP, rounding), 0.25 * TCC_STEP)))
        return tcc_say(p, TCC_DISCARD, "the communication step is %.12g s; it must be a whole number of ticks of %g s",
                       length, TCC_STEP);
    if (!(fabs(now - m->expected) <= rounding || fabs(now - tcc_time(m)) <= 0.01 * TCC_STEP))
        return tcc_say(p, TCC_ERROR, "the communication point is %.17g s; the step before ended at %.17g s", now, m->expected);
    answer = tcc_prepare(p);
    if (answer != TCC_OK) return answer;
    if (tcc_actuated(m->x)) {
        needed = tcc_press(m, tcc_highest(m), tcc_highest(m));
        if (!(needed <= TCC_SUBSTEP_LIMIT))
            return tcc_say(p, TCC_DISCARD, "a tick of %g s needs %.0f sub-steps; at most %d are allowed", TCC_STEP, needed,
                           TCC_SUBSTEP_LIMIT);
        m->substeps = (int)needed;
    }
    if (!(ticks * m->substeps <= TCC_MOST_SUBSTEPS) || m->tick > TCC_MOST_TICKS)
        return tcc_say(p, TCC_DISCARD, "the communication step is %.12g s, %.0f sub-steps; at most %.0f are allowed", length,
                       ticks * m->substeps, TCC_MOST_SUBSTEPS);
    memcpy(before, m->state, sizeof before);
    while (m->tick < first + (long long)ticks) tcc_tick(m);
    if (!isfinite(m->state[0] + m->state[1] + m->state[2] + m->state[3])) {
        memcpy(m->state, before, sizeof before);
        m->around = around;
        m->tick = first;
        return tcc_say(p, TCC_DISCARD, "the state would no longer be finite");
    }
    m->expected = now + length;
    tcc_outputs(m);
    return TCC_OK;
}

/* States that are kept: the model itself, behind a mark of this FMU and a sum over its bytes. */
typedef struct { char token[sizeof TCC_TOKEN]; unsigned long long sum; tcc_model model; } tcc_kept;

static unsigned long long tcc_sum(const tcc_model *m)
{
    unsigned long long sum = 14695981039346656037ULL;
    const unsigned char *bytes = (const unsigned char *)m;
    for (size_t k = 0; k < sizeof *m; k++) sum = (sum ^ bytes[k]) * 1099511628211ULL;
    return sum;
}

static tcc_answer tcc_keep(tcc_plant *p, void **kept)
{
    tcc_kept *k;
    if (!kept) return tcc_say(p, TCC_ERROR, "there is no place for the state");
    if (!*kept) *kept = calloc(1, sizeof(tcc_kept));
    if (!*kept) return tcc_say(p, TCC_ERROR, "there is no memory for the state");
    k = *kept;
    memcpy(k->token, TCC_TOKEN, sizeof k->token);
    memcpy(&k->model, &p->model, sizeof k->model);
    k->sum = tcc_sum(&k->model);
    return TCC_OK;
}

static tcc_answer tcc_whole(tcc_plant *p, const tcc_kept *kept)
{
    if (!kept || memcmp(kept->token, TCC_TOKEN, sizeof kept->token) || kept->sum != tcc_sum(&kept->model))
        return tcc_say(p, TCC_ERROR, "that is no state of this FMU, or it is damaged");
    return TCC_OK;
}

/* A state may come from a file, and its sum is no secret: numbers must be in their ranges, and what follows from them is
   worked out anew, to the same bits. */
static tcc_answer tcc_restore(tcc_plant *p, const void *kept)
{
    const tcc_model *m = kept ? &((const tcc_kept *)kept)->model : NULL;
    tcc_answer answer = tcc_whole(p, kept);
    if (answer != TCC_OK) return answer;
    for (int k = 0; answer == TCC_OK && k <= TCC_DELAY_TICKS; k++)
        answer = tcc_allowed(p, &tcc_variables[at_pressure_mean], m->around.waiting[k]);
    for (int k = 0; answer == TCC_OK && k < TCC_VARIABLES; k++) answer = tcc_allowed(p, &tcc_variables[k], m->x[k]);
    if (answer == TCC_OK && m->mode == TCC_STEP_MODE) {
        answer = tcc_allowed(p, &tcc_variables[at_pressure_frequency_ratio], m->ratio);
        if (answer == TCC_OK && TCC_FREQUENCY_POINTS == 0)
            answer = tcc_allowed(p, &tcc_variables[at_engine_frequency], m->frequency);
    }
    if (answer != TCC_OK || m->mode < TCC_INSTANTIATED || m->mode > TCC_TERMINATED || m->tick < 0 || m->tick > TCC_MOST_TICKS
        || !(m->around.pressure >= 0.0) || !isfinite(m->around.pressure + m->around.far_angle) || !isfinite(m->start_time) || !isfinite(m->expected) || !(m->origin.time >= 0.0)
        || !isfinite(m->origin.time + m->origin.phase + m->origin.lead) || !(fabs(m->x[at_stick_slip_state]) <= 1.0))
        return tcc_say(p, TCC_ERROR, "that state of this FMU holds a value that is not allowed");
    memcpy(&p->model, m, sizeof p->model);
    p->model.changed = 1;
    return TCC_OK;
}

static tcc_answer tcc_serialise(tcc_plant *p, const void *kept, void *bytes, size_t n)
{
    if (!bytes || n < sizeof(tcc_kept)) return tcc_say(p, TCC_ERROR, "a state has %zu bytes, not %zu", sizeof(tcc_kept), n);
    if (tcc_whole(p, kept) != TCC_OK) return TCC_ERROR;
    memcpy(bytes, kept, sizeof(tcc_kept));
    return TCC_OK;
}

static tcc_answer tcc_deserialise(tcc_plant *p, const void *bytes, size_t n, void **kept)
{
    tcc_kept *found;
    tcc_answer answer;
    if (!kept || !bytes || n != sizeof(tcc_kept)) return tcc_say(p, TCC_ERROR, "a state has %zu bytes, not %zu", sizeof(tcc_kept), n);
    found = malloc(sizeof *found);
    if (!found) return tcc_say(p, TCC_ERROR, "there is no memory for the state");
    memcpy(found, bytes, sizeof *found);
    answer = tcc_whole(p, found);
    if (answer != TCC_OK) {
        free(found);
        return answer;
    }
    free(*kept);
    *kept = found;
    return TCC_OK;
}

#endif

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
/* Variables of long profiles are not on the stack, but one for each thread where the compiler has such. */
#if defined(__GNUC__)
#define TCC_LARGE static __thread
#elif defined(_MSC_VER)
#define TCC_LARGE static __declspec(thread)
#else
#define TCC_LARGE
#endif
#include "tcc_profile.h"
#include "tcc_kernel.h"

/* Sub-steps of one communication step, some ten seconds of a processor, and ticks in all: time is still exact there. */
#define TCC_MOST_SUBSTEPS 1e8
#define TCC_MOST_TICKS 9000000000000000LL

typedef enum { TCC_OK, TCC_DISCARD, TCC_ERROR } tcc_answer;
typedef enum { TCC_INSTANTIATED, TCC_INITIALIZATION, TCC_STEP_MODE, TCC_TERMINATED } tcc_mode;

/* The actuator's pressure, the angle of the shaft's far end, and the commands that wait out the actuator's dead time. */
typedef struct { double pressure, far_angle, waiting[TCC_DELAY_TICKS + 1]; } tcc_around;

typedef struct {
    double x[TCC_VARIABLES];       /* every variable, by its reference */
    double state[4];               /* slip speed, plate angle, plate speed, flywheel angle */
    double start_time, stick_speed;
    double expected;               /* the communication point that comes next, as the importer counts */
    long long tick;
    Terms terms;
    Origin origin;                 /* of the phases, after the frequency or the pressure's ratio to it were changed */
    double used[TCC_VARIABLES];    /* the variables of the terms */
    tcc_around around;
    int substeps, mode, changed;   /* changed: terms are to be worked out anew */
} tcc_model;

/* fresh: terms of changed values until they are checked. */
typedef struct { tcc_model model; Terms fresh; char said[400]; } tcc_plant;

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

/* Whether the times of every profile begin with 0 and increase. */
static tcc_answer tcc_increasing(tcc_plant *p)
{
    for (int j = 0; j < TCC_PROFILES; j++)
        for (int k = tcc_times[j][0]; k < tcc_times[j][0] + tcc_times[j][1]; k++)
            if (k == tcc_times[j][0] ? p->model.x[k] != 0.0 : !(p->model.x[k] > p->model.x[k - 1]))
                return tcc_say(p, TCC_DISCARD, "%s is %g s; the first time must be 0 and the others increase",
                               tcc_variables[k].name, p->model.x[k]);
    return TCC_OK;
}

static tcc_answer tcc_few(tcc_plant *p, double substeps)
{
    if (substeps <= TCC_SUBSTEP_LIMIT) return TCC_OK;
    return tcc_say(p, TCC_DISCARD, "a tick of %g s needs %.0f sub-steps; at most %d are allowed", TCC_STEP, substeps,
                   TCC_SUBSTEP_LIMIT);
}

/* Work out the terms of changed values, all or nothing, as tcc_sim.plant.driveline does. */
static tcc_answer tcc_prepare(tcc_plant *p)
{
    tcc_model *m = &p->model;
    const double *x = m->x;
    double fixed = x[at_friction_static_coefficient], sliding = x[at_friction_kinetic_coefficient], needed;
    Origin origin = m->origin;
    Terms *terms = &p->fresh;
    if (!m->changed) return TCC_OK;
    if (!TCC_TABLE && (sliding < fixed / TCC_LARGEST_RATIO || sliding > fixed * TCC_LARGEST_RATIO))
        return tcc_say(p, TCC_DISCARD, "friction.kinetic_coefficient is %g; with friction.static_coefficient %g it must be "
                       "one twentieth of it to twenty times it", sliding, fixed);
    if (tcc_increasing(p) != TCC_OK) return TCC_DISCARD;
    if (m->mode == TCC_STEP_MODE) tcc_origin_after(m->used, x, &m->origin, (double)m->tick * TCC_STEP, &origin);
    tcc_terms_of(x, &origin, terms);
#if TCC_ENGINE_TOPIC
    tcc_hold_torque(terms, x[at_engine_torque], terms);
#endif
#if TCC_PRESSURE_TOPIC
    tcc_hold_pressure(x, terms, x[at_actuation_pressure], terms);
#endif
    needed = tcc_substeps(terms, TCC_STEP, 0.0);
    if (tcc_few(p, needed) != TCC_OK) return TCC_DISCARD;
    m->terms = *terms;
    m->origin = origin;
    memcpy(m->used, x, sizeof m->used);
    m->stick_speed = tcc_stick_speed(terms);
    m->substeps = (int)needed;
    m->changed = 0;
    return TCC_OK;
}

#if TCC_PRESSURE_TOPIC
/* Whether an actuator changes the commanded pressure. */
static int tcc_actuated(const double *x) { return tcc_lagged(x) || TCC_DELAY_TICKS > 0; }

/* Let the actuator's pressure go from one value to another in the next tick, and give back the sub-steps that it needs. */
static double tcc_press(tcc_model *m, double before, double after)
{
    const double *x = m->x;
    tcc_hold_pressure(x, &m->terms, tcc_largest(x, before, after), &m->terms);
    m->terms.approach.has = m->terms.approach.rows = tcc_lagged(x);
    if (tcc_lagged(x)) {
        tuple_dddd row = tcc_course((double)m->tick * TCC_STEP, before, after, tcc_torque_per_pressure(x),
                                    x[at_pressure_time_constant], x[at_pressure_rate_limit], TCC_STEP);
        memcpy(m->terms.approach.at[0], &row, sizeof row);
    }
    return tcc_substeps(&m->terms, TCC_STEP, 0.0);
}

/* The highest pressure that the commands until now lead to. */
static double tcc_highest(const tcc_model *m)
{
    double found = fmax(m->around.pressure, m->x[at_actuation_pressure]);
    for (int k = 0; k < TCC_DELAY_TICKS; k++) found = fmax(found, m->around.waiting[k]);
    return found;
}

/* One tick of the actuator. */
static void tcc_actuate(tcc_model *m)
{
    double *x = m->x, command = x[at_actuation_pressure], before = m->around.pressure;
    if (!tcc_actuated(x)) return;
    if (TCC_DELAY_TICKS > 0) {
        double *place = m->around.waiting + m->tick % (TCC_DELAY_TICKS + (TCC_DELAY_TICKS == 0));
        command = *place;
        *place = x[at_actuation_pressure];
    }
    m->around.pressure = tcc_pressure_after(before, command, x[at_pressure_time_constant], x[at_pressure_rate_limit], TCC_STEP);
    m->substeps = (int)tcc_press(m, before, m->around.pressure);
}

/* The pressure at the plates. */
static double tcc_applied(const tcc_model *m) { return tcc_actuated(m->x) ? m->around.pressure : m->x[at_actuation_pressure]; }

/* Fill the actuator with the mean pressure. */
static void tcc_fill(tcc_model *m)
{
    if (!tcc_actuated(m->x)) return;
    m->around.pressure = m->x[at_pressure_mean];
    for (int k = 0; k <= TCC_DELAY_TICKS; k++) m->around.waiting[k] = m->around.pressure;
    tcc_press(m, m->around.pressure, m->around.pressure);
}

/* The sub-steps of the highest pressure in a step to come. */
static tcc_answer tcc_headroom(tcc_plant *p)
{
    tcc_model *m = &p->model;
    double needed;
    if (!tcc_actuated(m->x)) return TCC_OK;
    needed = tcc_press(m, tcc_highest(m), tcc_highest(m));
    if (tcc_few(p, needed) != TCC_OK) return TCC_DISCARD;
    m->substeps = (int)needed;
    return TCC_OK;
}
#else
static void tcc_actuate(tcc_model *m) { (void)m; }
static void tcc_fill(tcc_model *m) { (void)m; }
static tcc_answer tcc_headroom(tcc_plant *p) { (void)p; return TCC_OK; }
static double tcc_applied(const tcc_model *m)
{
    return tcc_pressure_at((double)m->tick * TCC_STEP, m->x, &m->terms, m->origin.lead);
}
#endif

/* One tick of the actuator, the far end and the driveline. */
static void tcc_tick(tcc_model *m)
{
    double *x = m->x, *far = m->terms.far.at[0];
    tcc_actuate(m);
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
    tuple_dd torques = tcc_engine_and_friction(t, v, &m->terms);
    x[at_time] = m->start_time + t;
    x[at_slip_speed] = v;
    x[at_plate_angle] = m->state[1];
    x[at_plate_speed] = m->state[2];
    x[at_flywheel_angle] = m->state[3];
    x[at_flywheel_speed] = v + m->state[2];
    x[at_applied_engine_torque] = torques._0;
    x[at_friction_torque] = torques._1;
    x[at_stick_slip_state] = tcc_side_of_slip(v, m->stick_speed);
    x[at_shaft_torque] = tcc_shaft_torque(x, m->state[1] - m->around.far_angle, m->state[2] - x[at_output_speed]);
    x[at_applied_pressure] = tcc_applied(m);
}

/* The initial state of the values as they are. */
static tcc_answer tcc_initialise(tcc_plant *p)
{
    tcc_model *m = &p->model;
    tuple_dddd state;
    tcc_answer answer = tcc_prepare(p);
    if (answer != TCC_OK) return answer;
    state = tcc_initial_state(m->x);
    memcpy(m->state, &state, sizeof state);
    m->tick = 0;
    m->around.far_angle = 0.0;
    tcc_fill(m);
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
    double ticks = floor(length / TCC_STEP + 0.5), before[4], rounding = 4.0 * (nextafter(fabs(now), INFINITY) - fabs(now));
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
    answer = tcc_headroom(p);
    if (answer != TCC_OK) return answer;
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
    for (int k = 0; answer == TCC_OK && m->mode == TCC_STEP_MODE && k < TCC_VARIABLES; k++)
        answer = tcc_allowed(p, &tcc_variables[k], m->used[k]);
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

/* FMI 3.0 for co-simulation around tcc_model.h. It declares what it needs of the standard by itself; where fmi3Functions.h
   was included before, by an importer that has it, the compiler compares the two. */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "tcc_model.h"

#ifndef fmi3Functions_h
typedef void *fmi3Instance, *fmi3InstanceEnvironment, *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef float fmi3Float32;
typedef double fmi3Float64;
typedef int8_t fmi3Int8;
typedef uint8_t fmi3UInt8, fmi3Byte;
typedef int16_t fmi3Int16;
typedef uint16_t fmi3UInt16;
typedef int32_t fmi3Int32;
typedef uint32_t fmi3UInt32;
typedef int64_t fmi3Int64;
typedef uint64_t fmi3UInt64;
typedef bool fmi3Boolean, fmi3Clock;
typedef char fmi3Char;
typedef const fmi3Char *fmi3String;
typedef const fmi3Byte *fmi3Binary;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef enum { fmi3Independent, fmi3Constant, fmi3Fixed, fmi3Tunable, fmi3Discrete, fmi3Dependent } fmi3DependencyKind;
typedef enum { fmi3IntervalNotYetKnown, fmi3IntervalUnchanged, fmi3IntervalChanged } fmi3IntervalQualifier;
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);
typedef void (*fmi3ClockUpdateCallback)(fmi3InstanceEnvironment);
typedef void (*fmi3IntermediateUpdateCallback)(fmi3InstanceEnvironment, fmi3Float64, fmi3Boolean, fmi3Boolean, fmi3Boolean,
                                               fmi3Boolean, fmi3Boolean *, fmi3Float64 *);
typedef void (*fmi3LockPreemptionCallback)(void);
typedef void (*fmi3UnlockPreemptionCallback)(void);
#ifdef FMI3_FUNCTION_PREFIX
#define TCC_PREFIX FMI3_FUNCTION_PREFIX
#endif
#endif

typedef struct {
    tcc_plant plant;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} Instance;

static fmi3Status answer(Instance *i, tcc_answer found)
{
    static const fmi3Status statuses[] = {fmi3OK, fmi3Discard, fmi3Error};
    static const char *const categories[] = {"", "logStatusDiscard", "logStatusError"};
    if (found != TCC_OK && i->log) i->log(i->environment, statuses[found], categories[found], i->plant.said);
    return statuses[found];
}

#define V(name) fmi3##name
#define STATE(before, after) fmi3##before##FMUState##after
#include "fmi_shared.h"

OTHER(const char *, fmi3GetVersion, void) { return "3.0"; }

static fmi3Instance refuse(fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, const char *why)
{
    if (log) log(environment, fmi3Error, "logStatusError", why);
    return NULL;
}

OTHER(fmi3Instance, fmi3InstantiateCoSimulation, fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
      fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return, const fmi3ValueReference intermediate[], size_t n,
      fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    Instance *i;
    (void)name; (void)resources; (void)visible; (void)logging; (void)early_return; (void)intermediate; (void)n; (void)update;
    if (!token || strcmp(token, TCC_TOKEN)) return refuse(environment, log, "the token is not that of this FMU");
    if (event_mode) return refuse(environment, log, "this FMU has no event mode");
    i = calloc(1, sizeof *i);
    if (!i) return NULL;
    i->environment = environment;
    i->log = log;
    tcc_reset(&i->plant);
    return i;
}

OTHER(fmi3Instance, fmi3InstantiateModelExchange, fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
      fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    (void)name; (void)token; (void)resources; (void)visible; (void)logging;
    return refuse(environment, log, "this FMU is for co-simulation only");
}

OTHER(fmi3Instance, fmi3InstantiateScheduledExecution, fmi3String name, fmi3String token, fmi3String resources,
      fmi3Boolean visible, fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
      fmi3ClockUpdateCallback clock, fmi3LockPreemptionCallback lock, fmi3UnlockPreemptionCallback unlock)
{
    (void)name; (void)token; (void)resources; (void)visible; (void)logging; (void)clock; (void)lock; (void)unlock;
    return refuse(environment, log, "this FMU is for co-simulation only");
}

FUNCTION(fmi3EnterInitializationMode, fmi3Instance c, fmi3Boolean tolerance_defined, fmi3Float64 tolerance, fmi3Float64 start,
         fmi3Boolean stop_defined, fmi3Float64 stop)
{
    (void)tolerance_defined; (void)tolerance; (void)stop_defined; (void)stop;
    return answer(c, tcc_enter_initialization(&((Instance *)c)->plant, start));
}

FUNCTION(fmi3Reset, fmi3Instance c)
{
    tcc_reset(&((Instance *)c)->plant);
    return fmi3OK;
}

static tcc_answer counted(Instance *i, size_t references, size_t values)
{
    return references == values ? TCC_OK
        : tcc_say(&i->plant, TCC_ERROR, "%zu references have %zu values", references, values);
}

FUNCTION(fmi3GetFloat64, fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Float64 values[], size_t m)
{
    Instance *i = c;
    tcc_answer found = counted(i, n, m);
    if (found == TCC_OK) found = tcc_readable(&i->plant, r, n, TCC_REAL);
    for (size_t k = 0; found == TCC_OK && k < n; k++) values[k] = i->plant.model.x[r[k]];
    return answer(i, found);
}

FUNCTION(fmi3GetInt32, fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Int32 values[], size_t m)
{
    Instance *i = c;
    tcc_answer found = counted(i, n, m);
    if (found == TCC_OK) found = tcc_readable(&i->plant, r, n, TCC_INTEGER);
    for (size_t k = 0; found == TCC_OK && k < n; k++) values[k] = (fmi3Int32)i->plant.model.x[r[k]];
    return answer(i, found);
}

FUNCTION(fmi3SetFloat64, fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Float64 values[], size_t m)
{
    tcc_answer found = counted(c, n, m);
    if (found == TCC_OK) found = tcc_set(&((Instance *)c)->plant, r, n, values);
    return answer(c, found);
}

#define NONE(name, type) FUNCTION(name, fmi3Instance c, const fmi3ValueReference r[], size_t n, type values[], size_t m) \
{ (void)r; (void)values; (void)m; return n ? unsupported(c, "no variable has this type, or it cannot be set") : fmi3OK; }
#define BOTH(name) NONE(fmi3Get##name, fmi3##name) NONE(fmi3Set##name, const fmi3##name)
BOTH(Float32) BOTH(Int8) BOTH(UInt8) BOTH(Int16) BOTH(UInt16) NONE(fmi3SetInt32, const fmi3Int32) BOTH(UInt32) BOTH(Int64)
BOTH(UInt64) BOTH(Boolean) BOTH(String)

FUNCTION(fmi3GetBinary, fmi3Instance c, const fmi3ValueReference r[], size_t n, size_t sizes[], fmi3Binary values[], size_t m)
{
    (void)r; (void)sizes; (void)values; (void)m;
    return n ? unsupported(c, "there is no Binary variable") : fmi3OK;
}

FUNCTION(fmi3SetBinary, fmi3Instance c, const fmi3ValueReference r[], size_t n, const size_t sizes[], const fmi3Binary values[],
         size_t m)
{
    (void)r; (void)sizes; (void)values; (void)m;
    return n ? unsupported(c, "there is no Binary variable") : fmi3OK;
}

FUNCTION(fmi3DoStep, fmi3Instance c, fmi3Float64 now, fmi3Float64 length, fmi3Boolean no_return, fmi3Boolean *event,
         fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last)
{
    Instance *i = c;
    tcc_answer found = tcc_do_step(&i->plant, now, length);
    (void)no_return;
    *event = *terminate = *early = false;
    *last = tcc_time(&i->plant.model);
    return answer(i, found);
}

FUNCTION(fmi3DeserializeFMUState, fmi3Instance c, const fmi3Byte bytes[], size_t n, fmi3FMUState *s)
{
    return answer(c, tcc_deserialise(&((Instance *)c)->plant, bytes, n, s));
}

/* What this FMU does not have. */

#define NOT(name, ...) FUNCTION(name, fmi3Instance c, __VA_ARGS__)
#define IS_NOT { return unsupported(c, "this FMU does not provide that function"); }
#define PLAIN(name) FUNCTION(name, fmi3Instance c) IS_NOT
#ifdef __GNUC__
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
PLAIN(fmi3EnterEventMode) PLAIN(fmi3EnterConfigurationMode) PLAIN(fmi3ExitConfigurationMode) PLAIN(fmi3EnterStepMode)
PLAIN(fmi3EvaluateDiscreteStates) PLAIN(fmi3EnterContinuousTimeMode)
NOT(fmi3GetClock, const fmi3ValueReference r[], size_t n, fmi3Clock v[]) IS_NOT
NOT(fmi3SetClock, const fmi3ValueReference r[], size_t n, const fmi3Clock v[]) IS_NOT
NOT(fmi3GetNumberOfVariableDependencies, fmi3ValueReference r, size_t *n) IS_NOT
NOT(fmi3GetVariableDependencies, fmi3ValueReference r, size_t e[], fmi3ValueReference i[], size_t f[], fmi3DependencyKind k[],
    size_t n) IS_NOT
NOT(fmi3GetDirectionalDerivative, const fmi3ValueReference u[], size_t nu, const fmi3ValueReference k[], size_t nk,
    const fmi3Float64 s[], size_t ns, fmi3Float64 d[], size_t nd) IS_NOT
NOT(fmi3GetAdjointDerivative, const fmi3ValueReference u[], size_t nu, const fmi3ValueReference k[], size_t nk,
    const fmi3Float64 s[], size_t ns, fmi3Float64 d[], size_t nd) IS_NOT
NOT(fmi3GetIntervalDecimal, const fmi3ValueReference r[], size_t n, fmi3Float64 v[], fmi3IntervalQualifier q[]) IS_NOT
NOT(fmi3GetIntervalFraction, const fmi3ValueReference r[], size_t n, fmi3UInt64 v[], fmi3UInt64 w[], fmi3IntervalQualifier q[])
IS_NOT
NOT(fmi3GetShiftDecimal, const fmi3ValueReference r[], size_t n, fmi3Float64 v[]) IS_NOT
NOT(fmi3GetShiftFraction, const fmi3ValueReference r[], size_t n, fmi3UInt64 v[], fmi3UInt64 w[]) IS_NOT
NOT(fmi3SetIntervalDecimal, const fmi3ValueReference r[], size_t n, const fmi3Float64 v[]) IS_NOT
NOT(fmi3SetIntervalFraction, const fmi3ValueReference r[], size_t n, const fmi3UInt64 v[], const fmi3UInt64 w[]) IS_NOT
NOT(fmi3SetShiftDecimal, const fmi3ValueReference r[], size_t n, const fmi3Float64 v[]) IS_NOT
NOT(fmi3SetShiftFraction, const fmi3ValueReference r[], size_t n, const fmi3UInt64 v[], const fmi3UInt64 w[]) IS_NOT
NOT(fmi3UpdateDiscreteStates, fmi3Boolean *a, fmi3Boolean *b, fmi3Boolean *d, fmi3Boolean *e, fmi3Boolean *f, fmi3Float64 *t)
IS_NOT
NOT(fmi3CompletedIntegratorStep, fmi3Boolean a, fmi3Boolean *b, fmi3Boolean *d) IS_NOT
NOT(fmi3SetTime, fmi3Float64 t) IS_NOT
NOT(fmi3SetContinuousStates, const fmi3Float64 v[], size_t n) IS_NOT
NOT(fmi3GetContinuousStateDerivatives, fmi3Float64 v[], size_t n) IS_NOT
NOT(fmi3GetEventIndicators, fmi3Float64 v[], size_t n) IS_NOT
NOT(fmi3GetContinuousStates, fmi3Float64 v[], size_t n) IS_NOT
NOT(fmi3GetNominalsOfContinuousStates, fmi3Float64 v[], size_t n) IS_NOT
NOT(fmi3GetNumberOfEventIndicators, size_t *n) IS_NOT
NOT(fmi3GetNumberOfContinuousStates, size_t *n) IS_NOT
NOT(fmi3GetOutputDerivatives, const fmi3ValueReference r[], size_t n, const fmi3Int32 o[], fmi3Float64 v[], size_t m) IS_NOT
NOT(fmi3ActivateModelPartition, fmi3ValueReference r, fmi3Float64 t) IS_NOT

/* FMI 2.0 for co-simulation around tcc_model.h. It declares what it needs of the standard by itself; where fmi2Functions.h
   was included before, by an importer that has it, the compiler compares the two. */
#include <stddef.h>
#include "tcc_model.h"

#ifndef fmi2Functions_h
typedef void *fmi2Component, *fmi2ComponentEnvironment, *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer, fmi2Boolean;
typedef char fmi2Char, fmi2Byte;
typedef const fmi2Char *fmi2String;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;
typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;
#ifdef FMI2_FUNCTION_PREFIX
#define TCC_PREFIX FMI2_FUNCTION_PREFIX
#endif
#endif

typedef struct {
    tcc_plant plant;
    double start_time, last_time;
    const fmi2CallbackFunctions *callbacks;
    char name[];
} Instance;

static fmi2Status answer(Instance *i, tcc_answer found)
{
    static const fmi2Status statuses[] = {fmi2OK, fmi2Discard, fmi2Error};
    static const char *const categories[] = {"", "logStatusDiscard", "logStatusError"};
    if (found != TCC_OK && i->callbacks && i->callbacks->logger)
        /* A format without arguments, which importers written in other languages can read: no sentence has a %. */
        i->callbacks->logger(i->callbacks->componentEnvironment, i->name, statuses[found], categories[found], i->plant.said);
    return statuses[found];
}

#define V(name) fmi2##name
#define STATE(before, after) fmi2##before##FMUstate##after
#include "fmi_shared.h"

OTHER(const char *, fmi2GetTypesPlatform, void) { return "default"; }
OTHER(const char *, fmi2GetVersion, void) { return "2.0"; }

OTHER(fmi2Component, fmi2Instantiate, fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
      const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    Instance *i;
    (void)resources; (void)visible; (void)logging;
    if (!name) name = "";
    i = calloc(1, sizeof *i + strlen(name) + 1);
    if (!i) return NULL;
    strcpy(i->name, name);
    i->callbacks = callbacks;
    tcc_reset(&i->plant);
    if (type == fmi2CoSimulation && guid && !strcmp(guid, TCC_TOKEN)) return i;
    answer(i, tcc_say(&i->plant, TCC_ERROR, type == fmi2CoSimulation ? "the GUID is not that of this FMU"
                      : "this FMU is for co-simulation only"));
    free(i);
    return NULL;
}

FUNCTION(fmi2SetupExperiment, fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
         fmi2Boolean stop_defined, fmi2Real stop)
{
    Instance *i = c;
    (void)tolerance_defined; (void)tolerance; (void)stop_defined; (void)stop;
    if (!isfinite(start)) return answer(i, tcc_say(&i->plant, TCC_DISCARD, "the start time is %g; it must be a number", start));
    if (i->plant.model.mode != TCC_INSTANTIATED) return unsupported(c, "an experiment is set up before initialisation");
    i->start_time = start;
    return fmi2OK;
}

FUNCTION(fmi2EnterInitializationMode, fmi2Component c)
{
    return answer(c, tcc_enter_initialization(&((Instance *)c)->plant, ((Instance *)c)->start_time));
}

FUNCTION(fmi2Reset, fmi2Component c)
{
    tcc_reset(&((Instance *)c)->plant);
    ((Instance *)c)->start_time = 0.0;
    return fmi2OK;
}

FUNCTION(fmi2GetReal, fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real values[])
{
    Instance *i = c;
    tcc_answer found = tcc_readable(&i->plant, r, n, TCC_REAL);
    for (size_t k = 0; found == TCC_OK && k < n; k++) values[k] = i->plant.model.x[r[k]];
    return answer(i, found);
}

FUNCTION(fmi2GetInteger, fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Integer values[])
{
    Instance *i = c;
    tcc_answer found = tcc_readable(&i->plant, r, n, TCC_INTEGER);
    for (size_t k = 0; found == TCC_OK && k < n; k++) values[k] = (fmi2Integer)i->plant.model.x[r[k]];
    return answer(i, found);
}

FUNCTION(fmi2SetReal, fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real values[])
{
    return answer(c, tcc_set(&((Instance *)c)->plant, r, n, values));
}

#define NONE(name, type, what) FUNCTION(name, fmi2Component c, const fmi2ValueReference r[], size_t n, type values[]) \
{ (void)r; (void)values; return n ? unsupported(c, what) : fmi2OK; }
NONE(fmi2SetInteger, const fmi2Integer, "no Integer variable can be set")
NONE(fmi2GetBoolean, fmi2Boolean, "there is no Boolean variable")
NONE(fmi2SetBoolean, const fmi2Boolean, "there is no Boolean variable")
NONE(fmi2GetString, fmi2String, "there is no String variable")
NONE(fmi2SetString, const fmi2String, "there is no String variable")

FUNCTION(fmi2DoStep, fmi2Component c, fmi2Real now, fmi2Real length, fmi2Boolean no_return)
{
    (void)no_return;
    return answer(c, tcc_do_step(&((Instance *)c)->plant, now, length));
}

FUNCTION(fmi2CancelStep, fmi2Component c) { return unsupported(c, "no step is under way"); }

FUNCTION(fmi2DeSerializeFMUstate, fmi2Component c, const fmi2Byte bytes[], size_t n, fmi2FMUstate *s)
{
    return answer(c, tcc_deserialise(&((Instance *)c)->plant, bytes, n, s));
}

FUNCTION(fmi2GetDirectionalDerivative, fmi2Component c, const fmi2ValueReference z[], size_t nz, const fmi2ValueReference v[],
         size_t nv, const fmi2Real dv[], fmi2Real dz[])
{
    (void)z; (void)nz; (void)v; (void)nv; (void)dv; (void)dz;
    return unsupported(c, "directional derivatives are not provided");
}

FUNCTION(fmi2SetRealInputDerivatives, fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer order[],
         const fmi2Real values[])
{
    (void)r; (void)order; (void)values;
    return n ? unsupported(c, "inputs are held from step to step") : fmi2OK;
}

FUNCTION(fmi2GetRealOutputDerivatives, fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer order[],
         fmi2Real values[])
{
    (void)r; (void)order; (void)values;
    return n ? unsupported(c, "derivatives of outputs are not provided") : fmi2OK;
}

FUNCTION(fmi2GetRealStatus, fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    if (kind != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = tcc_time(&((Instance *)c)->plant.model);
    return fmi2OK;
}

#define STATUS(name, type) FUNCTION(name, fmi2Component c, const fmi2StatusKind kind, type *value) \
{ (void)c; (void)kind; (void)value; return fmi2Discard; }
STATUS(fmi2GetStatus, fmi2Status)
STATUS(fmi2GetIntegerStatus, fmi2Integer)
STATUS(fmi2GetBooleanStatus, fmi2Boolean)
STATUS(fmi2GetStringStatus, fmi2String)

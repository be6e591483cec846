/* A PI controller as an FMU 2.0 for co-simulation: pressure from slip speed. Variables: 0 slip_speed, 1 y, 2 gain, 3 time. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#define STUB(name) int name(void) { return 3; }

typedef struct { double at[4], integral; } PI;

void *fmi2Instantiate(const char *name, int type, const char *token, const char *where, void *calls, int visible, int log)
{
    PI *pi = calloc(1, sizeof *pi);
    (void)name; (void)type; (void)where; (void)calls; (void)visible; (void)log;
    pi->at[2] = 1400.0;
    return strcmp(token, "{pi}") ? NULL : pi;
}

static void answer(PI *pi) { pi->at[1] = 90000.0 + pi->integral + pi->at[2] * (pi->at[0] - 20.0); }
void fmi2FreeInstance(PI *pi) { free(pi); }
int fmi2SetupExperiment(PI *pi, int t, double tol, double start, int s, double stop)
{
    (void)t; (void)tol; (void)s; (void)stop;
    pi->at[3] = start;
    return 0;
}
int fmi2EnterInitializationMode(PI *pi) { (void)pi; return 0; }
int fmi2ExitInitializationMode(PI *pi) { answer(pi); return 0; }
int fmi2Reset(PI *pi) { memset(pi, 0, sizeof *pi); pi->at[2] = 1400.0; return 0; }
int fmi2SetReal(PI *pi, const unsigned *at, size_t n, const double *x)
{
    for (size_t k = 0; k < n; k++) pi->at[at[k]] = x[k];
    return 0;
}
int fmi2GetReal(PI *pi, const unsigned *at, size_t n, double *x)
{
    for (size_t k = 0; k < n; k++) x[k] = pi->at[at[k]];
    return 0;
}
int fmi2DoStep(PI *pi, double now, double step, int last)
{
    (void)last;
    if (fabs(now - pi->at[3]) > 1e-9 || pi->at[0] > 1000.0) return 3;
    pi->integral = pi->integral + 5200.0 * step * (pi->at[0] - 20.0);
    pi->at[3] = now + step;
    answer(pi);
    return 0;
}
STUB(fmi2GetTypesPlatform) STUB(fmi2GetVersion) STUB(fmi2SetDebugLogging) STUB(fmi2Terminate) STUB(fmi2GetInteger)
STUB(fmi2GetBoolean) STUB(fmi2GetString) STUB(fmi2SetInteger) STUB(fmi2SetBoolean) STUB(fmi2SetString) STUB(fmi2CancelStep)
STUB(fmi2GetFMUstate) STUB(fmi2SetFMUstate) STUB(fmi2FreeFMUstate) STUB(fmi2SerializedFMUstateSize) STUB(fmi2SerializeFMUstate)
STUB(fmi2DeSerializeFMUstate) STUB(fmi2GetDirectionalDerivative) STUB(fmi2SetRealInputDerivatives)
STUB(fmi2GetRealOutputDerivatives) STUB(fmi2GetStatus) STUB(fmi2GetRealStatus) STUB(fmi2GetIntegerStatus)
STUB(fmi2GetBooleanStatus) STUB(fmi2GetStringStatus)

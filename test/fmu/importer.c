/* An importer of the tests' own: it is linked with the sources of an FMU 2.0 and does what standard input says, one call a
   line; it answers with the status, and with values as hexadecimal numbers. Usage: importer GUID STEP */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "fmi2Functions.h"

static void logged(fmi2ComponentEnvironment e, fmi2String name, fmi2Status status, fmi2String category, fmi2String text, ...)
{
    va_list words;
    (void)e;
    va_start(words, text);
    printf("%s %d %s: ", name, status, category);
    vprintf(text, words);
    puts("");
    va_end(words);
}

int main(int n, char **words)
{
    fmi2CallbackFunctions callbacks = {logged, NULL, NULL, NULL, NULL};
    fmi2Component c = n > 2 ? fmi2Instantiate("one", fmi2CoSimulation, words[1], "", &callbacks, fmi2False, fmi2False) : NULL;
    fmi2Component other = fmi2Instantiate("other", fmi2CoSimulation, "{none}", NULL, &callbacks, fmi2False, fmi2False);
    fmi2FMUstate kept = NULL;
    fmi2Byte *bytes = NULL;
    char line[200], what[40], text[80];
    double step = n > 2 ? atof(words[2]) : 0.0, now = 0.0, value;
    size_t size = 0;
    if (!c || other || fmi2Instantiate(NULL, fmi2ModelExchange, words[1], NULL, NULL, 0, 0)) return 1;
    while (fgets(line, sizeof line, stdin)) {
        unsigned reference = 0;
        fmi2Status status = fmi2OK;
        int whole;
        *text = 0;
        if (sscanf(line, "%39s %u %79s", what, &reference, text) < 1) continue;
        value = strtod(text, NULL);
        if (!strcmp(what, "begin")) {
            status = fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0);
            if (status == fmi2OK) status = fmi2EnterInitializationMode(c);
            if (status == fmi2OK) status = fmi2ExitInitializationMode(c);
        } else if (!strcmp(what, "set")) status = fmi2SetReal(c, &reference, 1, &value);
        else if (!strcmp(what, "setinteger")) { whole = 1; status = fmi2SetInteger(c, &reference, 1, &whole); }
        else if (!strcmp(what, "get")) {
            status = fmi2GetReal(c, &reference, 1, &value);
            if (status == fmi2OK) printf("%a\n", value);
        } else if (!strcmp(what, "getinteger")) {
            status = fmi2GetInteger(c, &reference, 1, &whole);
            if (status == fmi2OK) printf("%d\n", whole);
        } else if (!strcmp(what, "step")) {
            for (unsigned k = 0; k < reference && status == fmi2OK; k++) {
                status = fmi2DoStep(c, now, step, fmi2True);
                if (status == fmi2OK) now += step;
            }
        } else if (!strcmp(what, "part")) status = fmi2DoStep(c, now, value, fmi2True);
        else if (!strcmp(what, "elsewhere")) status = fmi2DoStep(c, value, step, fmi2True);
        else if (!strcmp(what, "time")) { status = fmi2GetRealStatus(c, fmi2LastSuccessfulTime, &value); printf("%a\n", value); }
        else if (!strcmp(what, "save")) status = fmi2GetFMUstate(c, &kept);
        else if (!strcmp(what, "restore")) status = fmi2SetFMUstate(c, kept);
        else if (!strcmp(what, "restorenothing")) status = fmi2SetFMUstate(c, NULL);
        else if (!strcmp(what, "serialise")) {
            status = fmi2SerializedFMUstateSize(c, kept, &size);
            bytes = realloc(bytes, size);
            if (status == fmi2OK) status = fmi2SerializeFMUstate(c, kept, bytes, size - reference);
        } else if (!strcmp(what, "damage")) bytes[size - 9] ^= 1;
        else if (!strcmp(what, "deserialise")) status = fmi2DeSerializeFMUstate(c, bytes, size, &kept);
        else if (!strcmp(what, "at")) now = value;
        else if (!strcmp(what, "free")) status = fmi2FreeFMUstate(c, &kept);
        else if (!strcmp(what, "reset")) { status = fmi2Reset(c); now = 0.0; }
        else if (!strcmp(what, "terminate")) status = fmi2Terminate(c);
        else return 2;
        printf("= %d\n", status);
    }
    fmi2FreeFMUstate(c, &kept);
    fmi2FreeInstance(c);
    free(bytes);
    return 0;
}

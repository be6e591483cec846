/* CVODE of SUNDIALS (BDF, dense Jacobian by hand) on equations (1), (2) with the friction law (7), for `precision`.
   Standard input: I1 I2 C23 K23, A R, mu_s mu_k alpha sigma, Tm Tp omega, Pm Pp ratio psi, v theta2 omega2 at t = 0,
   rtol and three absolute tolerances, cycles, samples per cycle, repeats.
   Standard output: least and largest CPU seconds of `repeats` runs that keep the cycle ends, and their steps; the states
   at the cycle ends; the states of one more run at all samples. */
#include <cvode/cvode.h>
#include <math.h>
#include <nvector/nvector_serial.h>
#include <stdio.h>
#include <stdlib.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>
#include <time.h>

typedef struct {
    double I1, I2, C, K, area, radius, mus, muk, alpha, sigma, Tm, Tp, omega, Pm, Pp, ratio, psi, start[3], rtol, atol[3];
} Scene;

static double load(double t, const Scene *s)
{
    return s->muk * s->area * s->radius * fmax(0.0, s->Pm + s->Pp * sin(s->ratio * s->omega * t + s->psi));
}

static int rates(sunrealtype t, N_Vector y, N_Vector out, void *user)
{
    const Scene *s = user;
    const double *x = N_VGetArrayPointer(y);
    double *d = N_VGetArrayPointer(out), v = x[0];
    double torque = load(t, s) * (1.0 + (s->mus / s->muk - 1.0) * exp(-s->alpha * fabs(v))) * tanh(s->sigma * v);
    double plate = (torque - s->C * x[2] - s->K * x[1]) / s->I2;
    d[0] = (s->Tm + s->Tp * sin(s->omega * t) - torque) / s->I1 - plate;
    d[1] = x[2];
    d[2] = plate;
    return 0;
}

static int jacobian(sunrealtype t, N_Vector y, N_Vector f, SUNMatrix J, void *user, N_Vector a, N_Vector b, N_Vector c)
{
    const Scene *s = user;
    double v = N_VGetArrayPointer(y)[0], fall = (s->mus / s->muk - 1.0) * exp(-s->alpha * fabs(v));
    double step = tanh(s->sigma * v), sign = (v > 0.0) - (v < 0.0);
    double slope = load(t, s) * (s->sigma * (1.0 + fall) * (1.0 - step * step) - s->alpha * sign * fall * step);
    double row[3] = {slope / s->I2, -s->K / s->I2, -s->C / s->I2};
    (void)f, (void)a, (void)b, (void)c;
    for (int k = 0; k < 3; k++) {
        SM_ELEMENT_D(J, 0, k) = -row[k] - (k == 0 ? slope / s->I1 : 0.0);
        SM_ELEMENT_D(J, 1, k) = k == 2;
        SM_ELEMENT_D(J, 2, k) = row[k];
    }
    return 0;
}

/* One run with `count` outputs at equal times; their states go to `out`, of (count + 1) rows. Returns CPU seconds. */
static double run(Scene *s, double end, long count, double *out, long *steps)
{
    SUNContext context;
    N_Vector y, atol;
    struct timespec a, b;
    sunrealtype t;
    SUNContext_Create(0, &context);
    y = N_VNew_Serial(3, context);
    atol = N_VNew_Serial(3, context);
    for (int k = 0; k < 3; k++) {
        out[k] = N_VGetArrayPointer(y)[k] = s->start[k];
        N_VGetArrayPointer(atol)[k] = s->atol[k];
    }
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &a);
    void *memory = CVodeCreate(CV_BDF, context);
    CVodeInit(memory, rates, 0.0, y);
    CVodeSVtolerances(memory, s->rtol, atol);
    CVodeSetUserData(memory, s);
    SUNMatrix J = SUNDenseMatrix(3, 3, context);
    SUNLinearSolver solver = SUNLinSol_Dense(y, J, context);
    CVodeSetLinearSolver(memory, solver, J);
    CVodeSetJacFn(memory, jacobian);
    CVodeSetMaxNumSteps(memory, 100000000);
    for (long n = 1; n <= count; n++) {
        int flag = CVode(memory, end * n / count, y, &t, CV_NORMAL);
        if (flag < 0) {
            fprintf(stderr, "CVODE stopped with flag %d\n", flag);
            exit(1);
        }
        for (int k = 0; k < 3; k++)
            out[3 * n + k] = N_VGetArrayPointer(y)[k];
    }
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &b);
    CVodeGetNumSteps(memory, steps);
    CVodeFree(&memory);
    SUNLinSolFree(solver);
    SUNMatDestroy(J);
    N_VDestroy(y);
    N_VDestroy(atol);
    SUNContext_Free(&context);
    return (b.tv_sec - a.tv_sec) + 1e-9 * (b.tv_nsec - a.tv_nsec);
}

static void print(const double *rows, long count)
{
    for (long n = 0; n <= count; n++)
        printf("%.17g %.17g %.17g\n", rows[3 * n], rows[3 * n + 1], rows[3 * n + 2]);
}

int main(void)
{
    Scene s;
    long cycles, samples, repeats, steps = 0;
    double *numbers = (double *)&s, best = HUGE_VAL, slowest = 0.0;
    for (size_t k = 0; k < sizeof s / sizeof(double); k++)
        if (scanf("%lf", numbers + k) != 1)
            return 2;
    if (scanf("%ld %ld %ld", &cycles, &samples, &repeats) != 3)
        return 2;
    double end = cycles * 8.0 * atan(1.0) / s.omega, *out = malloc(sizeof(double) * 3 * (cycles * samples + 1));
    for (long k = 0; k < (repeats > 0 ? repeats : 1); k++) {
        double used = run(&s, end, cycles, out, &steps);
        best = fmin(best, used);
        slowest = fmax(slowest, used);
    }
    printf("%.9g %.9g %ld\n", best, slowest, steps);
    print(out, cycles);
    run(&s, end, cycles * samples, out, &steps);
    print(out, cycles * samples);
    return 0;
}

/* Contenders of the benchmark in C, and the clock around their calls.
 *
 * in_c.py compiles this file for one vehicle: CA_N rotors and CA_M axes, whose numbers are in
 * data.h, and the kernel of the exact allocator; with WITH_OSQP also the code that OSQP generates.
 */
#define _POSIX_C_SOURCE 199309L
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <time.h>

#include "exact.h"
#include "methods.h"

typedef int contender(const double *u, double *thrusts);

static ca_problem problem;

/* Prepare the kernel; returns an enum ca_fault. */
int set_up(void)
{
    static const ca_options options = OPTIONS;
    return ca_set_up(&problem, CA_N, CA_M, &matrix[0][0], lower, upper, &options);
}

int nothing(const double *u, double *thrusts)
{
    thrusts[0] = u[0];
    return 1;
}

int exact(const double *u, double *thrusts)
{
    ca_allocate(&problem, u, thrusts);
    return 1;
}

/* DAQP's structures and functions, of version 0.11.0: they are in the Python package's library,
 * which comes without headers. Of the workspace only the size matters, and it is ample. */
typedef struct {
    int n, m, simple;
    double *hessian, *cost, *rows, *upper, *lower;
    int *sense, *breaks, levels, type;
} daqp_problem;

typedef struct {
    double *x, *multipliers, value, slack;
    int flag, iterations, nodes;
    double solve_time, setup_time;
} daqp_result;

enum { DAQP_OPTIMAL = 1, DAQP_EQUALITY = 5, DAQP_UPDATE_BOUNDS = 8 };

static int (*daqp_update)(int, void *, daqp_problem *);
static void (*daqp_solve)(daqp_result *, void *);
static double daqp_workspace[1024], daqp_hessian[CA_N * CA_N], daqp_cost[CA_N];
static double daqp_lower[CA_N + CA_M], daqp_upper[CA_N + CA_M], daqp_multipliers[CA_N + CA_M];
static int daqp_sense[CA_N + CA_M];
static daqp_problem daqp_data = {CA_N, CA_N + CA_M, CA_N, daqp_hessian, daqp_cost,
                                 &matrix[0][0], daqp_upper, daqp_lower, daqp_sense, NULL, 0, 0};

/* Set DAQP up with the addresses of its functions, at a wrench; returns a number above 0. */
int set_up_daqp(int (*begin)(daqp_problem *, void *, double *),
                int (*update)(int, void *, daqp_problem *), void (*solve)(daqp_result *, void *),
                const double *u)
{
    double time;
    daqp_update = update;
    daqp_solve = solve;
    for (int i = 0; i < CA_N; i++)
        daqp_hessian[i * CA_N + i] = 1.0;
    memcpy(daqp_lower, lower, sizeof lower);
    memcpy(daqp_upper, upper, sizeof upper);
    for (int k = 0; k < CA_M; k++) {
        daqp_lower[CA_N + k] = daqp_upper[CA_N + k] = u[k];
        daqp_sense[CA_N + k] = DAQP_EQUALITY;
    }
    return begin(&daqp_data, daqp_workspace, &time);
}

int daqp_reused(const double *u, double *thrusts)
{
    daqp_result result = {.x = thrusts, .multipliers = daqp_multipliers};
    for (int k = 0; k < CA_M; k++)
        daqp_lower[CA_N + k] = daqp_upper[CA_N + k] = u[k];
    if (daqp_update(DAQP_UPDATE_BOUNDS, daqp_workspace, &daqp_data) < 0)
        return 0;
    daqp_solve(&result, daqp_workspace);
    return result.flag == DAQP_OPTIMAL;
}

static int64_t now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (int64_t)time.tv_sec * 1000000000 + time.tv_nsec;
}

/* Time all calls together [ns]. */
int64_t together(contender *call, size_t size, const double *wrenches)
{
    double thrusts[CA_N];
    const int64_t start = now();
    for (size_t i = 0; i < size; i++)
        call(wrenches + i * CA_M, thrusts);
    return now() - start;
}

/* Time each call [ns], and keep thrusts[size][CA_N] and whether they are an answer. */
void one_by_one(contender *call, size_t size, const double *wrenches, double *thrusts,
                signed char *answered, int64_t *times)
{
    for (size_t i = 0; i < size; i++) {
        const int64_t start = now();
        answered[i] = (signed char)call(wrenches + i * CA_M, thrusts + i * CA_N);
        times[i] = now() - start;
    }
}

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

enum { DAQP_EQUALITY = 5, DAQP_UPDATE_BOUNDS = 8, DAQP_UPDATE_SENSE = 16 };

static int (*daqp_update)(int, void *, daqp_problem *);
static void (*daqp_solve)(daqp_result *, void *);

/* A program of DAQP: the bounds, then Gamma f = u, whose rows may be in another order. */
typedef struct {
    double workspace[1024], hessian[CA_N * CA_N], cost[CA_N], rows[CA_M * CA_N];
    double lower[CA_N + CA_M], upper[CA_N + CA_M], multipliers[CA_N + CA_M];
    int sense[CA_N + CA_M], breaks[CA_M + 1], order[CA_M], update;
    daqp_problem data;
} daqp_program;

static daqp_program least_norm, hierarchy;

static void set_wrench(daqp_program *p, const double *u)
{
    for (int k = 0; k < CA_M; k++)
        p->lower[CA_N + k] = p->upper[CA_N + k] = u[p->order[k]];
}

static int begin_program(daqp_program *p, int (*begin)(daqp_problem *, void *, double *),
                         const double *u)
{
    double time;
    for (int i = 0; i < CA_N; i++)
        p->hessian[i * CA_N + i] = 1.0;
    for (int k = 0; k < CA_M; k++)
        memcpy(p->rows + k * CA_N, matrix[p->order[k]], sizeof matrix[0]);
    memcpy(p->lower, lower, sizeof lower);
    memcpy(p->upper, upper, sizeof upper);
    set_wrench(p, u);
    p->data = (daqp_problem){CA_N, CA_N + CA_M, CA_N, p->hessian, p->cost, p->rows, p->upper,
                             p->lower, p->sense, p->data.levels ? p->breaks : NULL,
                             p->data.levels, 0};
    return begin(&p->data, p->workspace, &time);
}

/* Set DAQP up with the addresses of its functions, at a wrench; returns a number above 0. */
int set_up_daqp(int (*begin)(daqp_problem *, void *, double *),
                int (*update)(int, void *, daqp_problem *), void (*solve)(daqp_result *, void *),
                const double *u)
{
    static const ca_options options = OPTIONS;
    daqp_update = update;
    daqp_solve = solve;
    least_norm.update = DAQP_UPDATE_BOUNDS;
    /* The levels change the active set: it begins anew. */
    hierarchy.update = DAQP_UPDATE_BOUNDS + DAQP_UPDATE_SENSE;
    for (int k = 0; k < CA_M; k++) {
        least_norm.order[k] = k;
        least_norm.sense[CA_N + k] = DAQP_EQUALITY;
        hierarchy.order[k] = options.order[k];
        hierarchy.breaks[options.group[k] + 1] = CA_N + k + 1;
    }
    hierarchy.breaks[0] = CA_N;
    hierarchy.data.levels = options.group[CA_M - 1] + 2;
    const int begun = begin_program(&least_norm, begin, u);
    return begun > 0 ? begin_program(&hierarchy, begin, u) : begun;
}

static int solve_program(daqp_program *p, const double *u, double *thrusts)
{
    daqp_result result = {.x = thrusts, .multipliers = p->multipliers};
    set_wrench(p, u);
    if (daqp_update(p->update, p->workspace, &p->data) < 0)
        return 0;
    daqp_solve(&result, p->workspace);
    return result.flag > 0;
}

int daqp_reused(const double *u, double *thrusts)
{
    return solve_program(&least_norm, u, thrusts);
}

int daqp_hierarchical(const double *u, double *thrusts)
{
    return solve_program(&hierarchy, u, thrusts);
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

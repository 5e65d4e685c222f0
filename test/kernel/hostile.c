/* Hostile inputs for the kernel: `hostile COUNT [SEED]` ends with 0 if each got a sound answer.
 *
 * A third of the problems are faulty in one way and must be refused. A third have some numbers of
 * any size; they may be refused. Problems that are not refused get wrenches of which many are no
 * numbers, infinite, huge or denormal. The sanitizers look for everything else.
 */
#include <float.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "explanation.h"

#ifdef CA_FLOAT
#define TOLERANCE 2e-5
#define TINY FLT_MIN
#define HUGE_NUMBER FLT_MAX
#define REFUSED 1e13f
#else
#define TOLERANCE 2e-12
#define TINY DBL_MIN
#define HUGE_NUMBER 1e300
#define REFUSED 1e101
#endif

#define WRENCHES 50

static uint64_t state;

static uint64_t draw(void)
{
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return state;
}

static int below(int count) { return (int)(draw() % (uint64_t)count); }
static ca_real uniform(void) { return (ca_real)(draw() >> 40) / (ca_real)(1 << 24); }

static ca_real hostile(void)
{
    const ca_real numbers[] = {
        (ca_real)NAN,  (ca_real)INFINITY, -(ca_real)INFINITY, HUGE_NUMBER,   -HUGE_NUMBER,
        REFUSED,       (ca_real)1e11,     (ca_real)-1e11,     (ca_real)1e6,  -1000,
        1,             (ca_real)1e-6,     TINY,               TINY / 1024,   -TINY / 1024,
        (ca_real)-0.0, 0};
    return numbers[below((int)(sizeof numbers / sizeof *numbers))];
}

typedef struct {
    int n, m;
    ca_real gamma[CA_M * CA_N], lower[CA_N], upper[CA_N];
    ca_options options;
} input;

static void sound(input *x)
{
    memset(x, 0, sizeof *x);
#ifdef CA_FIXED
    x->m = CA_M;
    x->n = CA_N;
#else
    x->m = 1 + below(CA_M);
    x->n = x->m + below(CA_N - x->m + 1);
#endif
    for (int i = 0; i < x->n * x->m; i++)
        x->gamma[i] = below(8) ? 2 * uniform() - 1 : 0;
    for (int i = 0; i < x->n; i++) {
        x->lower[i] = below(2) ? 0 : -uniform();
        x->upper[i] = x->lower[i] + (ca_real)0.01 + 10 * uniform();
        x->options.weight[i] = (ca_real)0.1 + uniform();
        x->options.preferred[i] = 4 * uniform() - 2;
    }
    x->options.weighted = below(2);
    const int policies[] = {CA_PRIORITIZED, CA_SCALED, CA_REJECTED};
    x->options.policy = policies[below(3)];
    x->options.on_reference = 0;
    x->options.slack = below(2) ? 0 : (ca_real)1e-9;
    for (int k = 0; k < x->m; k++) {
        const int other = below(k + 1);
        x->options.order[k] = x->options.order[other];
        x->options.order[other] = k;
        x->options.group[k] = k ? x->options.group[k - 1] + below(2) : 0;
        x->options.keep_sense[k] = below(2);
        x->options.reference[k] = uniform();
    }
    x->options.airmode_limited = below(2);
    x->options.thrust = below(x->m + 1) - 1;
    x->options.airmode[0] = below(3) ? uniform() : (ca_real)below(2);
    x->options.airmode[1] = x->options.airmode[0] * (below(2) ? uniform() : 1);
}

/* Narrow the bounds, often to one value. */
static void narrow(ca_problem *p)
{
    ca_real lower[CA_N], upper[CA_N];
    for (int i = 0; i < p->n; i++) {
        const ca_real range = p->most[i] - p->least[i];
        lower[i] = p->least[i] + range * (below(4) ? uniform() : (ca_real)below(2));
        upper[i] = below(4) ? lower[i] + range * uniform() : lower[i];
    }
    ca_set_bounds(p, lower, upper);
}

/* Change some numbers to any others; the ranges stay ranges. */
static void distort(input *x)
{
    for (int i = 0; i < x->n * x->m; i++)
        if (!below(8))
            x->gamma[i] = hostile();
    for (int i = 0; i < x->n; i++)
        if (!below(8))
            x->upper[i] = x->lower[i] + (below(2) ? hostile() : 0);
    for (int i = 0; i < x->n; i++) {
        if (!below(8))
            x->options.weight[i] = hostile();
        if (!below(8))
            x->options.preferred[i] = hostile();
    }
    for (int k = 0; k < x->m; k++)
        if (!below(8))
            x->options.reference[k] = hostile();
    if (!below(8))
        x->options.slack = hostile();
    x->options.on_reference = below(2);
    if (!below(8))
        x->options.airmode[below(2)] = hostile();
}

/* Make one thing wrong; return the fault that must be found. */
static int spoil(input *x)
{
    const ca_real bad[] = {(ca_real)NAN, (ca_real)INFINITY, -(ca_real)INFINITY, HUGE_NUMBER,
                           REFUSED};
    const ca_real number = bad[below(5)];
    const int axis = below(x->m), rotor = below(x->n);
    switch (below(17)) {
    case 0: x->n = 0; return CA_BAD_SIZE;
    case 1: x->n = CA_N + 1 + below(1000); return CA_BAD_SIZE;
    case 2: x->m = -below(1000); return CA_BAD_SIZE;
    case 3: x->m = CA_M + 1; return CA_BAD_SIZE;
    case 4: x->gamma[axis * x->n + rotor] = number; return CA_BAD_NUMBER;
    case 5: x->lower[rotor] = number; return CA_BAD_NUMBER;
    case 6: x->upper[rotor] = number; return CA_BAD_NUMBER;
    case 7: x->lower[rotor] = x->upper[rotor] + 1; return CA_BAD_NUMBER;
    case 8: x->options.reference[axis] = number; return CA_BAD_NUMBER;
    case 9: x->options.slack = below(2) ? -1 : number; return CA_BAD_NUMBER;
    case 10: x->options.policy = below(2) ? CA_EXACT : CA_INEXACT; return CA_BAD_ORDER;
    case 11: x->options.policy = below(2) ? -1 : 99; return CA_BAD_ORDER;
    case 12: x->options.order[axis] = below(2) ? -1 : CA_M; return CA_BAD_ORDER;
    case 13: x->options.group[axis] += 2 + below(9); return CA_BAD_ORDER;
    case 14:
        x->options.weighted = 1;
        x->options.weight[rotor] = below(2) ? -uniform() : number;
        return CA_BAD_NUMBER;
    case 15:
        x->options.weighted = 1;
        x->options.preferred[rotor] = number;
        return CA_BAD_NUMBER;
    default:
        for (int i = 0; i < x->n; i++)
            x->gamma[axis * x->n + i] = 0;
        return CA_NO_VOLUME;
    }
}

static int fail(const char *what, const ca_problem *p, const ca_real *u, const ca_real *f,
                ca_answer answer)
{
    printf("%s: status %d, level %g, n %d, m %d\nu", what, answer.status, (double)answer.level,
           p->n, p->m);
    for (int k = 0; k < p->m; k++)
        printf(" %a", (double)u[k]);
    printf("\nthrusts");
    for (int i = 0; i < p->n; i++)
        printf(" %a in %a ... %a", (double)f[i], (double)p->lower[i], (double)p->upper[i]);
    printf("\n");
    return 0;
}

static int judge(const ca_problem *p, const ca_real *u, int exactly)
{
    ca_real f[CA_N], ones[CA_N], speeds[CA_N];
    int finite = 1;
    double size = 1, missed = 0;
    for (int i = 0; i < CA_N; i++) {
        f[i] = (ca_real)NAN;
        ones[i] = 1;
    }
    const ca_answer answer = ca_allocate(p, u, f);
    for (int i = 0; i < p->n; i++)
        if (!(p->lower[i] <= f[i] && f[i] <= p->upper[i]))
            return fail("a thrust is out of its bounds", p, u, f, answer);
    for (int k = 0; k < p->m; k++)
        finite = finite && isfinite(u[k]);
    if (answer.status < CA_EXACT || answer.status > CA_RATE_LIMITED ||
        (!finite && answer.status != CA_INVALID))
        return fail("a wrong status", p, u, f, answer);
    if (!(answer.level >= 0 && answer.level <= 1))
        return fail("a wrong level", p, u, f, answer);
    for (int k = 0; k < p->m && exactly && answer.status == CA_EXACT; k++) {
        size = fmax(size, fabs((double)u[k]));
        double left = (double)u[k];
        for (int i = 0; i < p->n; i++)
            left -= (double)p->gamma[k][i] * (double)f[i];
        missed = fmax(missed, fabs(left));
    }
    if (missed > (TOLERANCE + (double)p->slack) * size * CA_M + (double)p->rounding)
        return fail("not exact", p, u, f, answer);
    ca_speeds(p->n, f, ones, ones, p->lower, p->upper, speeds);
    for (int i = 0; i < p->n; i++)
        if (isnan(speeds[i]))
            return fail("a wrong speed", p, u, f, answer);
    return 1;
}

int main(int count, char **arguments)
{
    const long inputs = count > 1 ? strtol(arguments[1], NULL, 10) : 100000;
    long found[CA_RATE_LIMITED + 1] = {0}, refused[CA_BAD_ORDER + 1] = {0};
    state = 88172645463325252u ^ (count > 2 ? strtoull(arguments[2], NULL, 10) : 0);
    for (long done = 0; done < inputs;) {
        static input x;
        static ca_problem problem;
        sound(&x);
        const int kind = below(3), wanted = kind == 0 ? spoil(&x) : CA_SOUND;
        if (kind == 1)
            distort(&x);
        const int fault =
            ca_set_up(&problem, x.n, x.m, x.gamma, x.lower, x.upper, &x.options);
        refused[fault]++;
        done++;
        /* A random problem may have no volume. */
        if (kind != 1 && fault != wanted && fault != CA_NO_VOLUME) {
            printf("problem %ld: expected fault %d, got %d\n", done, wanted, fault);
            return 1;
        }
        if (fault)
            continue;
        for (int i = 0; i < WRENCHES && done < inputs; i++, done++) {
            ca_real u[CA_M];
            const int how = below(4);
            for (int k = 0; k < x.m; k++)
                u[k] = how == 0 || (how == 1 && below(2))
                           ? hostile()
                           : problem.center[k] +
                                 (ca_real)how * problem.extent[k] * (uniform() - (ca_real)0.5);
            if (!judge(&problem, u, kind == 2))
                return 1;
            ca_real f[CA_N];
            ca_explanation why;
            found[ca_allocate(&problem, u, f).status]++;
            if (problem.n <= 8)
                ca_explain(&problem, u, f, &why);
            for (int k = 0; problem.n <= 8 && k < problem.m; k++)
                if (!(why.served[k] >= 0 && why.served[k] <= 1)) {
                    printf("problem %ld: a wrong share\n", done);
                    return 1;
                }
            if (!below(2))
                narrow(&problem);
        }
        if (kind == 2 && x.n <= 8 && isnan(ca_margin(&problem, problem.center))) {
            printf("problem %ld: the margin is not a number\n", done);
            return 1;
        }
    }
    for (int status = 0; status <= CA_RATE_LIMITED; status++)
        printf("status %d: %ld\n", status, found[status]);
    for (int fault = 0; fault <= CA_BAD_ORDER; fault++)
        printf("fault %d: %ld\n", fault, refused[fault]);
    return 0;
}

/* Constants and functions shared by the files of the library. */
#ifndef CA_ROS_KERNEL_NUMBERS_H
#define CA_ROS_KERNEL_NUMBERS_H

#include <math.h>

#include "exact.h"

#define CA_REAL(x) ((ca_real)(x))
#define CA_INFINITY CA_REAL(INFINITY)

#ifdef CA_FLOAT
#define ca_abs fabsf
#define ca_sqrt sqrtf
#define CA_CHOOSE(in_double, in_float) ((ca_real)(in_float))
#define CA_CHOOSE_INT(in_double, in_float) (in_float)
#else
#define ca_abs fabs
#define ca_sqrt sqrt
#define CA_CHOOSE(in_double, in_float) ((ca_real)(in_double))
#define CA_CHOOSE_INT(in_double, in_float) (in_double)
#endif

/* With CA_FIXED all problems have CA_N rotors and CA_M axes, and loops have constant lengths; with
 * CA_FIXED_AXES this is so for the axes. */
#ifdef CA_FIXED
#define CA_FIXED_AXES
#define CA_ROTORS(problem) ((void)(problem), CA_N)
#else
#define CA_ROTORS(problem) ((problem)->n)
#endif
#ifdef CA_FIXED_AXES
#define CA_AXES(problem) ((void)(problem), CA_M)
#else
#define CA_AXES(problem) ((problem)->m)
#endif

/* Residual of an exact allocation, relative to max(1, |u|). */
#define CA_TOLERANCE CA_CHOOSE(1e-12, 1e-5)
/* Greatest number of a wrench or a problem. Its square is finite. */
#define CA_ABSURD CA_CHOOSE(1e100, 1e12)

static inline ca_real ca_min(ca_real a, ca_real b) { return a < b ? a : b; }
static inline ca_real ca_max(ca_real a, ca_real b) { return a > b ? a : b; }

static inline ca_real ca_clip(ca_real x, ca_real lower, ca_real upper)
{
    return ca_min(ca_max(x, lower), upper);
}

static inline ca_real ca_dot(int count, const ca_real *a, const ca_real *b)
{
    ca_real sum = 0;
    for (int i = 0; i < count; i++)
        sum += a[i] * b[i];
    return sum;
}

static inline ca_real ca_length(int count, const ca_real *a)
{
    return ca_sqrt(ca_dot(count, a, a));
}

static inline void ca_copy(int count, const ca_real *from, ca_real *to)
{
    for (int i = 0; i < count; i++)
        to[i] = from[i];
}

#define ca_leave CA_SYMBOL(ca_leave)
#define ca_priorities_set_up CA_SYMBOL(ca_priorities_set_up)
#define ca_prioritize CA_SYMBOL(ca_prioritize)
#define ca_attempt CA_SYMBOL(ca_attempt)
#define ca_least_norm CA_SYMBOL(ca_least_norm)
#define ca_least_norm_on_face CA_SYMBOL(ca_least_norm_on_face)
#define ca_settle CA_SYMBOL(ca_settle)

/* The attainable wrench that is served for a demand. */
typedef struct {
    ca_real wrench[CA_M];  /* attainable */
    ca_real thrusts[CA_N]; /* thrusts that produce it */
    int held[CA_N];        /* nonzero if a thrust is at its bound in all solutions */
    int unique;            /* whether there is only one solution */
    int least;             /* whether the thrusts have the least norm */
    int almost_parallel;   /* whether the facet is almost parallel to another one */
    int reached;           /* whether the wrench equals the demand, up to rounding */
    ca_real level;         /* smallest share of its demand that an axis got */
} ca_served;

/* left = u - Gamma f, in the units of the prepared problem. */
void ca_leave(const ca_problem *problem, const ca_real *u, const ca_real *f, ca_real *left);

/* Set `begin` and the fields after it. */
void ca_priorities_set_up(ca_problem *problem, int on_reference);
void ca_prioritize(const ca_problem *problem, const ca_real *u, ca_served *served, int *pivots,
                   int *steps);

/* Least-norm thrusts for u. The functions return |u - Gamma f| and count their steps. `attempt`
 * stops when u is proven or likely to be unattainable; `least_norm` can continue from its y. */
ca_real ca_attempt(const ca_problem *problem, const ca_real *u, ca_real tolerance,
                   ca_real *thrusts, ca_real *y, int *steps);
ca_real ca_least_norm(const ca_problem *problem, const ca_real *u, ca_real tolerance, int start,
                      ca_real *thrusts, ca_real *y, int *steps);
ca_real ca_least_norm_on_face(const ca_problem *problem, const ca_served *served,
                              ca_real tolerance, ca_real *thrusts, int *steps);

/* Remove the rounding error of u by the rotors between their bounds. */
ca_real ca_settle(const ca_problem *problem, const ca_real *u, ca_real tolerance, ca_real *thrusts,
                  int *steps);

#endif

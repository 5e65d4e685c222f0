/* Priorities: which wrench to serve if the demand is not attainable. */
#ifndef CA_ROS_KERNEL_PRIORITIES_H
#define CA_ROS_KERNEL_PRIORITIES_H

#include "least_norm.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ca_priorities_set_up CA_SYMBOL(ca_priorities_set_up)
#define ca_judge CA_SYMBOL(ca_judge)
#define ca_serve CA_SYMBOL(ca_serve)
#define ca_serve_wide CA_SYMBOL(ca_serve_wide)

/* Least weight of an axis in its group, as a share of its range, and relative to the greatest. */
#define CA_LAG 1e-3
#define CA_LAG_RATIO 1e-6

/* The attainable wrench that is served for a demand. */
typedef struct {
    ca_face face;
    int unique;            /* whether there is only one solution */
    int least;             /* whether the thrusts have the least norm */
    int almost_parallel;   /* whether the facet is almost parallel to another one */
    int reached;           /* whether the wrench equals the demand, up to rounding */
    ca_real level;         /* smallest share of its demand that an axis got */
} ca_served;

/* Set `begin` and the fields after it. */
void ca_priorities_set_up(ca_problem *problem, int on_reference);

/* Set `reached` and `level` of what is served of u. `share` is that of its line that the first group
 * gets, or -1; `doubt` the error of the wrench, as a share of the range of an axis. */
void ca_judge(const ca_problem *problem, const ca_real *u, ca_real share, ca_real doubt,
              ca_served *served);

/* Serve u. In single precision `ca_serve` returns 0 and sets nothing if rounding errors could have
 * decided; `ca_serve_wide`, in double precision and only there to answer then, returns 1. */
int ca_serve(const ca_problem *problem, const ca_real *u, ca_served *served, int *pivots,
             int *steps);
int ca_serve_wide(const ca_problem *problem, const ca_real *u, ca_served *served, int *pivots,
                  int *steps);

static inline void ca_prioritize(const ca_problem *problem, const ca_real *u, ca_served *served,
                                 int *pivots, int *steps)
{
#ifdef CA_FLOAT
    if (!ca_serve(problem, u, served, pivots, steps))
        ca_serve_wide(problem, u, served, pivots, steps);
#else
    ca_serve(problem, u, served, pivots, steps);
#endif
}

#ifdef __cplusplus
}
#endif

#endif

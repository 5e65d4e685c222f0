/* Priorities: which wrench to serve if the demand is not attainable. */
#ifndef CA_ROS_KERNEL_PRIORITIES_H
#define CA_ROS_KERNEL_PRIORITIES_H

#include "least_norm.h"
#include "numbers.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ca_priorities_set_up CA_SYMBOL(ca_priorities_set_up)
#define ca_judge CA_SYMBOL(ca_judge)
#define ca_serve CA_SYMBOL(ca_serve)
#define ca_serve_within CA_SYMBOL(ca_serve_within)
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

/* A plane that touches the admissible set: a supporting hyperplane. */
typedef struct {
    ca_real normal[CA_M];  /* outwards */
    ca_real toward[CA_M];  /* its multipliers, see `ca_search` */
    ca_real height;        /* along the normal, above the wrench of the middles of the bounds */
    int side[CA_N];        /* of each thrust there: -1 at its lower bound, 1 at its upper, 0 free */
} ca_plane;

/* Share of the greatest rate along the normal of a plane below which a rate is none; at most
 * CA_CLEAR it is not clear whether it is. */
#define CA_NONE CA_CHOOSE(1e-10, 1e-6)
#define CA_CLEAR CA_CHOOSE(1e-3, 1e-2)

/* 1: a rate counts, -1: it is none, 0: it is not clear. */
static inline int ca_clarity(ca_real rate, ca_real greatest)
{
    return rate > CA_CLEAR * greatest ? 1 : rate > CA_NONE * greatest ? 0 : -1;
}

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

/* Find the wrench that would be served of u if all wrenches on the inner side of the planes were
 * attainable, and which planes it touches. Returns 0 if that is not clear. */
int ca_serve_within(const ca_problem *problem, const ca_real *u, int count, const ca_plane *planes,
                    ca_real *wrench, int *touched, ca_real *share, int *pivots);

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

/* Priorities: which wrench to serve if the demand is not attainable. */
#ifndef CA_ROS_KERNEL_PRIORITIES_H
#define CA_ROS_KERNEL_PRIORITIES_H

#include "exact.h"
#include "least_norm.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ca_priorities_set_up CA_SYMBOL(ca_priorities_set_up)
#define ca_prioritize CA_SYMBOL(ca_prioritize)

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
void ca_prioritize(const ca_problem *problem, const ca_real *u, ca_served *served, int *pivots,
                   int *steps);

#ifdef __cplusplus
}
#endif

#endif

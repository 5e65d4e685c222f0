/* What the priorities serve of a wrench that planes exclude. */
#ifndef CA_ROS_KERNEL_FACET_H
#define CA_ROS_KERNEL_FACET_H

#include "priorities.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ca_serve_at_planes CA_SYMBOL(ca_serve_at_planes)

/* Serve the wrench of a search that has proven it unattainable, as `ca_serve` does, and find its
 * least-norm thrusts. Returns 0, with nothing set, if planes like that of the proof do not decide
 * what to serve: mostly far from the boundary. */
int ca_serve_at_planes(const ca_problem *problem, const ca_search *search, ca_served *served,
                       ca_real *thrusts, int *pivots);

#ifdef __cplusplus
}
#endif

#endif

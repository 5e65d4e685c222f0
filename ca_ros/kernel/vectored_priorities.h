/* Priorities of vectors in convex sets. */
#ifndef CA_ROS_KERNEL_VECTORED_PRIORITIES_H
#define CA_ROS_KERNEL_VECTORED_PRIORITIES_H

#include "vectored_problem.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ca_vectored_prioritize CA_SYMBOL(ca_vectored_prioritize)

/* Serve the axes in the order of their priority; returns the share of the way from `line_begin` to u
 * that the first group went. CA_N has to be at least the numbers of components and axes together. */
ca_real ca_vectored_prioritize(const ca_vectored *problem, const ca_real *u, ca_real *x,
                               ca_vectored_answer *answer);

#ifdef __cplusplus
}
#endif

#endif

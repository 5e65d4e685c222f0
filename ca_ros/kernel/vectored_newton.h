/* Newton's method for the vectors of least cost, and lines to the boundary of the attainable set. */
#ifndef CA_ROS_KERNEL_VECTORED_NEWTON_H
#define CA_ROS_KERNEL_VECTORED_NEWTON_H

#include "vectored_problem.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ca_vectored_solve CA_SYMBOL(ca_vectored_solve)
#define ca_vectored_line CA_SYMBOL(ca_vectored_line)

/* Find the vectors of least cost for u; without those, the nearest that were met. */
void ca_vectored_solve(const ca_vectored *problem, const ca_real *u, ca_real *x,
                       ca_vectored_answer *answer);

/* Go as far as possible along the wrenches begin + t way, at most to t = end; x are the vectors of
 * least cost there. `answer->level` is t. */
void ca_vectored_line(const ca_vectored *problem, const ca_real *begin, const ca_real *way,
                      ca_real end, ca_real *x, ca_vectored_answer *answer);

#ifdef __cplusplus
}
#endif

#endif

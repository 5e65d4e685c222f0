/* Exact allocation of vectors in convex sets: rotors that tilt, gimbals, azimuth thrusters.
 *
 *     minimise |W (x - x_p)|^2   subject to   B x = u,   x_i in C_i
 *
 * x_i are the 1, 2 or 3 components of the vector of effector i: a number in an interval, or a vector
 * in a sector, a cone with a round base, a disc or a ball. docs/tilting.md explains the method.
 * As in `exact.h`: no memory is allocated, no state is kept, and every loop has a bound. */
#ifndef CA_ROS_KERNEL_VECTORED_H
#define CA_ROS_KERNEL_VECTORED_H

#include "vectored_problem.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ca_vectored_allocate CA_SYMBOL(ca_vectored_allocate)
#define ca_vectored_command CA_SYMBOL(ca_vectored_command)

/* Find vectors x[n] in the sets for u[m]. */
void ca_vectored_allocate(const ca_vectored *problem, const ca_real *u, ca_real *x,
                          ca_vectored_answer *answer);

/* Lengths of the vectors within bounds, and angles of the servos within theirs [rad]. A rotor has 0,
 * 1 or 2 servos; the angles of its first one are counted from `middle`. A vector without a length
 * points along its axis. */
void ca_vectored_command(const ca_vectored *problem, const ca_real *x, const ca_real *shortest,
                         const ca_real *longest, const int *servos, const ca_real *middle,
                         const ca_real *least, const ca_real *greatest, ca_real *lengths,
                         ca_real *angles);

#ifdef __cplusplus
}
#endif

#endif

/* Exact allocation of vectors in convex sets: rotors that tilt, gimbals, azimuth thrusters.
 *
 *     minimise |W (x - x_p)|^2   subject to   B x = u,   x_i in C_i
 *
 * x_i are the 1, 2 or 3 components of the vector of effector i: a number in an interval, or a vector
 * in a sector, a cone with a round base, a disc or a ball. docs/tilting.md explains the method.
 * As in `exact.h`: no memory is allocated, no state is kept, and every loop has a bound. */
#ifndef CA_ROS_KERNEL_VECTORED_H
#define CA_ROS_KERNEL_VECTORED_H

#include "problem.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ca_vectored_allocate CA_SYMBOL(ca_vectored_allocate)
#define ca_vectored_solve CA_SYMBOL(ca_vectored_solve)
#define ca_vectored_line CA_SYMBOL(ca_vectored_line)
#define ca_vectored_prioritize CA_SYMBOL(ca_vectored_prioritize)
#define ca_vectored_command CA_SYMBOL(ca_vectored_command)

/* The prepared problem: constant data, which Python prepares. CA_N is the number of components.
 * Vectors turn about the axis of their set, so a set is given in the half plane of the components
 * along and across it. X(name, dimensions) */
#define CA_VECTORED_FIELDS(X) \
    X(sets, )                     /* number of sets, components and axes */ \
    X(components, ) \
    X(axes, ) \
    X(size, [CA_N])               /* number of components of each set */ \
    X(least, [CA_N])              /* end of an interval, or least component along the axis */ \
    X(radius, [CA_N])             /* other end of an interval, or greatest length */ \
    X(full, [CA_N])               /* nonzero for a disc or ball */ \
    X(cosine, [CA_N])             /* of the half angle */ \
    X(sine, [CA_N]) \
    X(flank, [CA_N])              /* where the flank begins; the radius if there is none */ \
    X(end_along, [CA_N])          /* where the arc ends */ \
    X(end_across, [CA_N]) \
    X(inner, [CA_N])              /* where the plane at `least` ends */ \
    X(matrix, [CA_M][CA_N])       /* B */ \
    X(weight, [CA_N])             /* W, the same for all components of a set */ \
    X(preferred, [CA_N])          /* x_p */ \
    X(basis, [CA_N][CA_M])        /* orthonormal columns that span the rows of B / W */ \
    X(rates, [CA_N][CA_M])        /* the same, each row divided by its weight */ \
    X(coordinates, [CA_M][CA_M])  /* u = B x is basis^T W x = coordinates u */ \
    X(start, [CA_M])              /* of the wrench of x_p */ \
    X(span, )                     /* greatest length of `coordinates` of a unit vector */ \
    X(terms, )                    /* length of the sums of the greatest |B x|, term by term */ \
    X(greatest, )                 /* greatest deviation |W (x - x_p)| of a component */ \
    X(slack, )                    /* see ca_options */ \
    X(policy, ) \
    X(reference, [CA_M])          /* from which demands are counted */ \
    X(begin, [CA_M])              /* an attainable wrench; there the line to a demand begins */ \
    X(on_reference, )             /* whether it is the reference */ \
    X(resting, [CA_N])            /* vectors of a wrench that is rejected */ \
    X(extent, [CA_M])             /* half of the range of each axis; from here on: priorities */ \
    X(middle, [CA_N])             /* vectors inside the sets */ \
    X(order, [CA_M])              /* axes, the most important first */ \
    X(group, [CA_M])              /* group of each entry of `order`, from 0 */ \
    X(sense, [CA_M])              /* nonzero if less important axes must not reverse an axis */ \
    X(line_begin, [CA_M])         /* where the line of the first group begins */

#define CA_VECTORED_MEMBER(name, dimensions) ca_real name dimensions;
typedef struct {
    CA_VECTORED_FIELDS(CA_VECTORED_MEMBER)
} ca_vectored;
#undef CA_VECTORED_MEMBER

/* The result of an allocation, besides the vectors. */
typedef struct {
    int status;             /* enum ca_status */
    int attained;           /* whether the vectors give the wrench */
    int unattainable;       /* whether a plane proves that none do */
    int steps;              /* Newton steps */
    ca_real level;          /* share of the demand that was served */
    ca_real most;           /* no greater one is attainable: proved by the support function */
    ca_real y[CA_M];        /* multipliers of B x = u; normal to the set where a line ends */
} ca_vectored_answer;

/* Find vectors x[n] in the sets for u[m]. */
void ca_vectored_allocate(const ca_vectored *problem, const ca_real *u, ca_real *x,
                          ca_vectored_answer *answer);

/* Find the vectors of least cost for u; without those, the nearest that were met. */
void ca_vectored_solve(const ca_vectored *problem, const ca_real *u, ca_real *x,
                       ca_vectored_answer *answer);

/* Go as far as possible along the wrenches begin + t way, at most to t = end; x are the vectors of
 * least cost there. `answer->level` is t. */
void ca_vectored_line(const ca_vectored *problem, const ca_real *begin, const ca_real *way,
                      ca_real end, ca_real *x, ca_vectored_answer *answer);

/* Serve the axes in the order of their priority; returns the share of the way from `line_begin` to u
 * that the first group went. CA_N has to be at least the numbers of components and axes together. */
ca_real ca_vectored_prioritize(const ca_vectored *problem, const ca_real *u, ca_real *x,
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

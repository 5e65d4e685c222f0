/* The data of a problem of vectors in convex sets, and the result of an allocation. */
#ifndef CA_ROS_KERNEL_VECTORED_PROBLEM_H
#define CA_ROS_KERNEL_VECTORED_PROBLEM_H

#include "problem.h"

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

/* With CA_FIXED all problems have CA_N components and CA_M axes. */
#ifdef CA_FIXED
#define CA_VECTORED_AXES(problem) ((void)(problem), CA_M)
#define CA_VECTORED_COMPONENTS(problem) ((void)(problem), CA_N)
#else
#define CA_VECTORED_AXES(problem) ((int)(problem)->axes)
#define CA_VECTORED_COMPONENTS(problem) ((int)(problem)->components)
#endif

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

#endif

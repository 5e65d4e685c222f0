/* The data of a problem: sizes, the type of numbers, options, and what `ca_set_up` prepares. */
#ifndef CA_ROS_KERNEL_PROBLEM_H
#define CA_ROS_KERNEL_PROBLEM_H

#include "configuration.h"

/* The type of all numbers. */
#ifdef CA_FLOAT
typedef float ca_real;
#else
typedef double ca_real;
/* -fsingle-precision-constant would round all constants. */
typedef char ca_constants_are_of_double_precision[sizeof 1.0 == sizeof(double) ? 1 : -1];
#endif

/* The names of the functions end in the numbers and the type, such as ca_allocate_6_4_float: files
 * that were compiled with different definitions do not link, and several vehicles do. */
#define CA_JOIN(name, n, m, type) name##_##n##_##m##_##type
#define CA_SUFFIXED(name, n, m, type) CA_JOIN(name, n, m, type)
#ifdef CA_FLOAT
#define CA_SYMBOL(name) CA_SUFFIXED(name, CA_N, CA_M, float)
#else
#define CA_SYMBOL(name) CA_SUFFIXED(name, CA_N, CA_M, double)
#endif

enum ca_status {
    CA_EXACT = 0,       /* the thrusts produce the wrench, up to rounding */
    CA_PRIORITIZED = 1, /* unattainable: axes served in the order of their priority */
    CA_SCALED = 2,      /* unattainable: scaled towards the reference */
    CA_INEXACT = 3,     /* an iteration reached its bound: the wrench is approximate */
    CA_REJECTED = 4,    /* unattainable, policy reject: thrusts nearest to zero */
    CA_INVALID = 5,     /* not finite or too large: thrusts nearest to zero */
    CA_RATE_LIMITED = 6 /* unattainable, prioritized or scaled: bounds that have moved limit it */
};

/* What to do with an unattainable wrench. */
typedef struct {
    int policy;              /* CA_PRIORITIZED, CA_SCALED or CA_REJECTED */
    int order[CA_M];         /* axes, the most important first */
    int group[CA_M];         /* group of each entry of `order`, in ascending order from 0; the axes
                                of one group are served together */
    int keep_sense[CA_M];    /* per axis: nonzero if less important axes must not reverse it */
    ca_real reference[CA_M]; /* the wrench from which demands are counted: hover [N, N m] */
    int on_reference;        /* nonzero if the reference is attainable, and lines begin there */
    ca_real slack;           /* greatest error of an attainable wrench near almost parallel facets
                                of the admissible set, as a share of max(1, |u|) */
    int weighted;            /* nonzero if the next two are given; zero for ones and zeros */
    ca_real weight[CA_N];    /* of the thrusts in the cost |weight (f - preferred)|^2, positive */
    ca_real preferred[CA_N]; /* preferred thrusts [N] */
    int airmode_limited;     /* nonzero if the next two are given; zero for no limits */
    int thrust;              /* the axis thrust, or -1 */
    ca_real airmode[2];      /* how far thrust may rise above its demand for the first group, and for
                                the others, as shares of its range; 1 is no limit. For the others
                                it is at most as far */
    int refined;             /* nonzero if the next two are given. In double precision it has no effect */
    ca_real rest[CA_M][CA_N]; /* what Gamma has beyond its numbers in single precision */
    int nearly_level;        /* nonzero if a rate of the simplex method may be so small that single
                                precision takes it for zero, and is not zero; see
                                `ca_ros.allocation.box_backend.has_nearly_level_edges` */
    int reports_health;      /* nonzero if the next is given */
    int impaired[CA_N];      /* nonzero if the health of a rotor lowers its upper bound */
} ca_options;

/* In single precision Gamma has a second part, for what is served in double precision. */
#ifdef CA_FLOAT
#define CA_REST(X) \
    X(int, refined, )                       /* whether the next two are given */ \
    X(int, nearly_level, ) \
    X(ca_real, rest, [CA_M][CA_N])
#else
#define CA_REST(X)
#endif

/* The prepared problem. It is constant data, and may be in flash. The least norm is that of the
 * deviations g = weight (f - preferred).
 * X(type, name, dimensions) */
#define CA_FIELDS(X) \
    X(int, n, )                             /* number of rotors */ \
    X(int, m, )                             /* number of axes */ \
    X(ca_real, gamma, [CA_M][CA_N])         /* control allocation matrix */ \
    CA_REST(X) \
    X(ca_real, lower, [CA_N])               /* bounds of the thrusts f [N] */ \
    X(ca_real, upper, [CA_N]) \
    X(ca_real, least, [CA_N])               /* the bounds at the set-up */ \
    X(ca_real, most, [CA_N]) \
    X(int, widened, )                       /* whether bounds are wider than at the set-up, which \
                                               `ca_explain` alone makes */ \
    X(int, impaired, [CA_N])                /* whether the health of a rotor lowers `most` */ \
    X(int, weighted, )                      /* whether a weight is not 1 or a preference not 0 */ \
    X(ca_real, weight, [CA_N]) \
    X(ca_real, preferred, [CA_N])           /* [N] */ \
    X(ca_real, offset, [CA_M])              /* wrench of the preferred thrusts [N, N m] */ \
    X(ca_real, deviation_lower, [CA_N])     /* bounds of g */ \
    X(ca_real, deviation_upper, [CA_N]) \
    X(ca_real, basis, [CA_N][CA_M])         /* orthonormal columns that span the rows of Gamma, \
                                               each column divided by its weight */ \
    X(ca_real, coordinates, [CA_M][CA_M])   /* Gamma f = u is basis^T g = coordinates (u - offset) */ \
    X(ca_real, back, [CA_M][CA_M])          /* inverse of `coordinates` */ \
    X(ca_real, greatest, )                  /* greatest size of a bound of g, at least 1 */ \
    X(ca_real, rounding, )                  /* greatest rounding error of Gamma f [N, N m] */ \
    X(ca_real, slack, ) \
    X(ca_real, middle, [CA_N])              /* middles and half lengths of the ranges of f [N] */ \
    X(ca_real, half_range, [CA_N]) \
    X(ca_real, center, [CA_M])              /* wrench of the middles */ \
    X(ca_real, extent, [CA_M])              /* half of the range of each axis */ \
    X(int, policy, ) \
    X(int, order, [CA_M]) \
    X(int, group, [CA_M]) \
    X(int, keep_sense, [CA_M]) \
    X(int, thrust, )                        /* the axis with a limit on airmode, or -1 */ \
    X(ca_real, rise, )                      /* the limit for the first group, scaled */ \
    X(ca_real, later_rise, )                /* and for the others */ \
    X(ca_real, reference, [CA_M]) \
    X(ca_real, begin, [CA_M])               /* where the line of the first group begins, scaled */ \
    X(int, on_reference, )                  /* whether it begins at the reference */ \
    X(int, basic, [CA_M])                   /* the simplex dictionary at this point */ \
    X(int, nonbasic, [CA_N]) \
    X(ca_real, rates, [CA_M][CA_N]) \
    X(ca_real, row_value, [CA_M])           /* its basic and nonbasic variables, scaled */ \
    X(ca_real, row_lower, [CA_M]) \
    X(ca_real, row_upper, [CA_M]) \
    X(ca_real, column_value, [CA_N]) \
    X(ca_real, column_lower, [CA_N]) \
    X(ca_real, column_upper, [CA_N]) \
    X(ca_real, doubt, )

#define CA_MEMBER(type, name, dimensions) type name dimensions;
typedef struct {
    CA_FIELDS(CA_MEMBER)
} ca_problem;
#undef CA_MEMBER

#endif

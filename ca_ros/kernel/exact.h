/* Exact control allocation for multirotors.
 *
 *     minimise |f|^2   subject to   Gamma f = u,   lower <= f <= upper
 *
 * or |W (f - f_p)|^2 with weights W and preferred thrusts f_p. f are the thrusts of n rotors [N],
 * u is a wrench of m axes [N, N m]. If no thrusts within the bounds produce u, a policy chooses an
 * attainable wrench. docs/exact.md and docs/priorities.md explain the methods. The equation numbers
 * are those of "Evaluation of Control Allocation Methods for Multirotor Aerial Vehicles".
 *
 * The library allocates no memory and keeps no state. A result depends only on the problem and the
 * wrench. Every loop has a bound.
 */
#ifndef CA_ROS_KERNEL_EXACT_H
#define CA_ROS_KERNEL_EXACT_H

/* Maximum numbers of rotors and axes. For a single vehicle, define them as its numbers; if all
 * problems have these numbers, define CA_FIXED too, or CA_FIXED_AXES if they have this number of
 * axes, which makes the code faster. */
#ifndef CA_N
#define CA_N 32
#endif
#ifndef CA_M
#define CA_M 6
#endif

/* The type of all numbers: define CA_FLOAT for single precision. */
#ifdef CA_FLOAT
typedef float ca_real;
#else
typedef double ca_real;
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
#define ca_set_up CA_SYMBOL(ca_set_up)
#define ca_allocate CA_SYMBOL(ca_allocate)
#define ca_residual CA_SYMBOL(ca_residual)
#define ca_active_set CA_SYMBOL(ca_active_set)
#define ca_margin CA_SYMBOL(ca_margin)
#define ca_speeds CA_SYMBOL(ca_speeds)

enum ca_status {
    CA_EXACT = 0,       /* the thrusts produce the wrench, up to rounding */
    CA_PRIORITIZED = 1, /* unattainable: axes served in the order of their priority */
    CA_SCALED = 2,      /* unattainable: scaled towards the reference */
    CA_INEXACT = 3,     /* an iteration reached its bound: the wrench is approximate */
    CA_REJECTED = 4,    /* unattainable, policy reject: thrusts nearest to zero */
    CA_INVALID = 5      /* not finite or too large: thrusts nearest to zero */
};

/* Results of `ca_set_up`. */
enum ca_fault {
    CA_SOUND = 0,
    CA_BAD_SIZE = 1,    /* n or m out of range */
    CA_BAD_NUMBER = 2,  /* a number is not finite, or lower > upper */
    CA_NO_VOLUME = 3,   /* the rotors cannot command the axes independently */
    CA_BAD_ORDER = 4    /* the priorities do not name each axis once, group by group */
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
} ca_options;

/* The prepared problem. It is constant data, and may be in flash. If it is weighted, it is solved for
 * g = weight (f - preferred): `gamma`, `lower`, `upper`, `reference` and what follows from them are
 * those of g, and of the wrench u - offset.
 * X(type, name, dimensions) */
#define CA_FIELDS(X) \
    X(int, n, )                             /* number of rotors */ \
    X(int, m, )                             /* number of axes */ \
    X(int, weighted, )                      /* whether a weight is not 1 or a preference not 0 */ \
    X(ca_real, weight, [CA_N]) \
    X(ca_real, preferred, [CA_N])           /* [N] */ \
    X(ca_real, offset, [CA_M])              /* wrench of the preferred thrusts [N, N m] */ \
    X(ca_real, thrust_lower, [CA_N])        /* bounds of the thrusts f [N] */ \
    X(ca_real, thrust_upper, [CA_N]) \
    X(ca_real, gamma, [CA_M][CA_N])         /* control allocation matrix */ \
    X(ca_real, lower, [CA_N])               /* bounds */ \
    X(ca_real, upper, [CA_N]) \
    X(ca_real, basis, [CA_N][CA_M])         /* orthonormal columns that span the rows of Gamma */ \
    X(ca_real, coordinates, [CA_M][CA_M])   /* Gamma f = u is basis^T f = coordinates u */ \
    X(ca_real, back, [CA_M][CA_M])          /* inverse of `coordinates` */ \
    X(ca_real, greatest, )                  /* greatest size of a bound, at least 1 */ \
    X(ca_real, slack, ) \
    X(ca_real, middle, [CA_N])              /* middles and half lengths of the ranges [N] */ \
    X(ca_real, half_range, [CA_N]) \
    X(ca_real, center, [CA_M])              /* wrench of the middles */ \
    X(ca_real, extent, [CA_M])              /* half of the range of each axis */ \
    X(int, policy, ) \
    X(int, order, [CA_M]) \
    X(int, group, [CA_M]) \
    X(int, keep_sense, [CA_M]) \
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

/* The result of an allocation, besides the thrusts. */
typedef struct {
    int status;    /* enum ca_status */
    ca_real level; /* smallest share of its demand that an axis got, from the reference */
    int steps;     /* Newton steps and corrections */
    int pivots;    /* pivots of the simplex method */
} ca_answer;

/* Prepare a problem. `gamma` has m rows of n numbers; returns an enum ca_fault. */
int ca_set_up(ca_problem *problem, int n, int m, const ca_real *gamma, const ca_real *lower,
              const ca_real *upper, const ca_options *options);

/* Find thrusts[n] for u[m]; they are within their bounds to the last bit. */
ca_answer ca_allocate(const ca_problem *problem, const ca_real *u, ca_real *thrusts);

/* residual[m] = u - Gamma f */
void ca_residual(const ca_problem *problem, const ca_real *u, const ca_real *thrusts,
                 ca_real *residual);

/* The active set, active[n]: -1 at the lower bound, +1 at the upper bound, 0 between them. */
void ca_active_set(const ca_problem *problem, const ca_real *thrusts, signed char *active);

/* Signed distance of u from the boundary of the admissible set, positive inside [N, N m]. The
 * function tests all choices of m - 1 rotors, which is slow for many rotors. */
ca_real ca_margin(const ca_problem *problem, const ca_real *u);

/* Rotor speeds [rad/s] of thrusts [N], f = k w^2 or, backwards, f = -k_reverse w^2, within speed_min
 * and speed_max, Eq. (11). The coefficients are positive. */
void ca_speeds(int n, const ca_real *thrusts, const ca_real *thrust_coefficient,
               const ca_real *reverse_coefficient, const ca_real *speed_min,
               const ca_real *speed_max, ca_real *speeds);

#endif

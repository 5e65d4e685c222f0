/* Exact control allocation for multirotors.
 *
 *     minimise |f|^2   subject to   Gamma f = u,   lower <= f <= upper
 *
 * f are the thrusts of n rotors [N], u is a wrench of m axes [N, N m]. For a wrench that no thrusts
 * within the bounds give, a policy chooses an attainable one. docs/exact.md and docs/priorities.md
 * explain the methods; equation numbers are those of "Evaluation of Control Allocation Methods for
 * Multirotor Aerial Vehicles".
 *
 * The library allocates no memory and keeps no state: an answer depends on the problem and the
 * wrench alone. Every loop has a bound.
 */
#ifndef CA_ROS_KERNEL_EXACT_H
#define CA_ROS_KERNEL_EXACT_H

/* Greatest numbers of rotors and axes: for one vehicle, define them as its numbers. */
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

enum ca_status {
    CA_EXACT = 0,       /* the wrench is given, to rounding */
    CA_PRIORITIZED = 1, /* unattainable; the axes were served in the order of their priority */
    CA_SCALED = 2,      /* unattainable; its direction from the reference was kept */
    CA_INEXACT = 3,     /* an iteration came to its bound: the thrusts give something near */
    CA_REJECTED = 4,    /* unattainable, and the policy is to reject; thrusts at lower bounds */
    CA_INVALID = 5      /* the wrench is not finite or absurd; thrusts at lower bounds */
};

/* What `ca_set_up` returns. */
enum ca_fault {
    CA_SOUND = 0,
    CA_BAD_SIZE = 1,    /* n or m out of range */
    CA_BAD_NUMBER = 2,  /* a number is not finite, or lower > upper */
    CA_NO_VOLUME = 3,   /* the rotors cannot command the axes independently */
    CA_BAD_ORDER = 4    /* the priorities do not name each axis once, group by group */
};

/* What to do about an unattainable wrench, and how fast rotors turn. */
typedef struct {
    int policy;              /* CA_PRIORITIZED, CA_SCALED or CA_REJECTED */
    int order[CA_M];         /* axes, the most important first */
    int group[CA_M];         /* group of each entry of `order`: 0, and up by 0 or 1 from one to the
                                next; axes of one group are served together */
    int keep_sense[CA_M];    /* per axis: nonzero if lesser amounts must not reverse it */
    ca_real reference[CA_M]; /* where demands are counted from: hover [N, N m] */
    int on_reference;        /* nonzero if lines begin at the reference, which is attainable */
    ca_real slack;           /* by how much of max(1, |u|) an attainable wrench may be missed where
                                facets of the admissible set are almost parallel */
} ca_options;

/* The problem as `ca_set_up` prepares it: constant data, which may lie in flash.
 * X(type, name, dimensions) */
#define CA_FIELDS(X) \
    X(int, n, )                             /* number of rotors */ \
    X(int, m, )                             /* number of axes */ \
    X(ca_real, gamma, [CA_M][CA_N])         /* control allocation matrix */ \
    X(ca_real, lower, [CA_N])               /* bounds of the thrusts [N] */ \
    X(ca_real, upper, [CA_N]) \
    X(ca_real, basis, [CA_N][CA_M])         /* orthonormal columns that span the rows of Gamma */ \
    X(ca_real, coordinates, [CA_M][CA_M])   /* Gamma f = u is basis^T f = coordinates u */ \
    X(ca_real, back, [CA_M][CA_M])          /* inverse of `coordinates` */ \
    X(ca_real, greatest, )                  /* greatest thrust, at least 1 N */ \
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
    X(int, on_reference, )                  /* whether that is the reference */ \
    X(int, basic, [CA_M])                   /* the simplex at the beginning of the line */ \
    X(int, nonbasic, [CA_N]) \
    X(ca_real, rates, [CA_M][CA_N]) \
    X(ca_real, thrust_value, [CA_N])        /* its variables: thrusts and axes, scaled */ \
    X(ca_real, axis_value, [CA_M]) \
    X(ca_real, axis_lower, [CA_M]) \
    X(ca_real, axis_upper, [CA_M]) \
    X(ca_real, doubt, )

#define CA_MEMBER(type, name, dimensions) type name dimensions;
typedef struct {
    CA_FIELDS(CA_MEMBER)
} ca_problem;
#undef CA_MEMBER

/* What became of a wrench. */
typedef struct {
    int status;    /* enum ca_status */
    ca_real level; /* least share of its demand that an axis got, counted from the reference */
    int steps;     /* Newton steps and corrections that were taken */
    int pivots;    /* moves of the simplex method that were taken */
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

/* Signed distance of u to the boundary of the admissible set, positive inside [N, N m]. It looks
 * at all choices of m - 1 rotors: for a few rotors fast, for many not. */
ca_real ca_margin(const ca_problem *problem, const ca_real *u);

/* Rotor speeds [rad/s] of thrusts [N], f = k w^2, within speed_min and speed_max, Eq. (11). */
void ca_speeds(int n, const ca_real *thrusts, const ca_real *thrust_coefficient,
               const ca_real *speed_min, const ca_real *speed_max, ca_real *speeds);

#endif

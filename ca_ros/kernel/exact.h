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

#include "problem.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ca_set_up CA_SYMBOL(ca_set_up)
#define ca_allocate CA_SYMBOL(ca_allocate)
#define ca_set_bounds CA_SYMBOL(ca_set_bounds)
#define ca_reach CA_SYMBOL(ca_reach)
#define ca_narrow CA_SYMBOL(ca_narrow)
#define ca_thrusts CA_SYMBOL(ca_thrusts)
#define ca_margin CA_SYMBOL(ca_margin)
#define ca_speeds CA_SYMBOL(ca_speeds)

/* Results of `ca_set_up`. */
enum ca_fault {
    CA_SOUND = 0,
    CA_BAD_SIZE = 1,    /* n or m out of range */
    CA_BAD_NUMBER = 2,  /* a number is not finite, or lower > upper */
    CA_NO_VOLUME = 3,   /* the rotors cannot control the axes independently */
    CA_BAD_ORDER = 4    /* the priorities do not name each axis once, group by group */
};

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

/* Narrow the bounds of the thrusts [N] to the given ones for the calls after this one, without a new
 * set-up: to what the rotors reach from the last thrusts, see `ca_reach`. The bounds of the set-up
 * hold as well. Returns CA_BAD_NUMBER, and changes nothing, if a bound is not finite or a lower one is
 * above its upper one. */
int ca_set_bounds(ca_problem *problem, const ca_real *lower, const ca_real *upper);

/* Signed distance of u from the boundary of the admissible set within the bounds of
 * `ca_set_bounds`, positive inside [N, N m]; below -1e35 if the set has no volume. The function
 * tests all choices of m - 1 rotors, which is slow for many rotors. */
ca_real ca_margin(const ca_problem *problem, const ca_real *u);

/* Rotor speeds [rad/s] of thrusts [N], f = k w^2 or, backwards, f = -k_reverse w^2, within speed_min
 * and speed_max, Eq. (11). The coefficients are positive. */
void ca_speeds(int n, const ca_real *thrusts, const ca_real *thrust_coefficient,
               const ca_real *reverse_coefficient, const ca_real *speed_min,
               const ca_real *speed_max, ca_real *speeds);

/* Least and greatest speeds that rotors reach from their speeds [rad/s] in `time` [s], within
 * speed_min and speed_max. `up` is the greatest rate at which a speed grows in size, and `down` at
 * which it shrinks, positive [rad/s^2]. */
void ca_reach(int n, const ca_real *speeds, ca_real time, const ca_real *up, const ca_real *down,
              const ca_real *speed_min, const ca_real *speed_max, ca_real *least,
              ca_real *greatest);

/* The same, and `ca_set_bounds` to the thrusts k w^2 of these speeds, in fewer instructions. */
void ca_narrow(ca_problem *problem, const ca_real *speeds, ca_real time, const ca_real *up,
               const ca_real *down, const ca_real *thrust_coefficient,
               const ca_real *reverse_coefficient, const ca_real *speed_min,
               const ca_real *speed_max, ca_real *least, ca_real *greatest);

/* Thrusts [N] of rotor speeds [rad/s]: the inverse of `ca_speeds`. */
void ca_thrusts(int n, const ca_real *speeds, const ca_real *thrust_coefficient,
                const ca_real *reverse_coefficient, ca_real *thrusts);

#ifdef __cplusplus
}
#endif

#endif

/* Least-norm thrusts within bounds, for a wrench or on a face of the admissible set. */
#ifndef CA_ROS_KERNEL_LEAST_NORM_H
#define CA_ROS_KERNEL_LEAST_NORM_H

#include "problem.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ca_leave CA_SYMBOL(ca_leave)
#define ca_rounding CA_SYMBOL(ca_rounding)
#define ca_within CA_SYMBOL(ca_within)
#define ca_start CA_SYMBOL(ca_start)
#define ca_attempt CA_SYMBOL(ca_attempt)
#define ca_least_norm CA_SYMBOL(ca_least_norm)
#define ca_least_norm_on_face CA_SYMBOL(ca_least_norm_on_face)
#define ca_least_norm_at_once CA_SYMBOL(ca_least_norm_at_once)
#define ca_settle CA_SYMBOL(ca_settle)

/* A wrench and Newton's method for it. */
typedef struct {
    const ca_real *wrench;
    ca_real size;        /* max(1, |wrench|) */
    ca_real tolerance;   /* greatest residual of an exact answer, if the sum Gamma f rounds to less */
    ca_real y[CA_M];     /* multipliers */
    int attainable;      /* whether the wrench is known to be attainable, up to rounding */
    int unattainable;    /* whether a plane proves that it is not */
    ca_real normal[CA_M]; /* of that plane */
    ca_real toward[CA_M]; /* its multipliers: normal = coordinates^T toward */
    int *steps;          /* number of steps, added up */
} ca_search;

/* Wrenches that the same thrusts at their bounds produce. */
typedef struct {
    ca_real wrench[CA_M];  /* one of them */
    ca_real thrusts[CA_N]; /* that produce it */
    int held[CA_N];        /* nonzero if a thrust is at its bound in all of them */
} ca_face;

/* left = u - Gamma f */
void ca_leave(const ca_problem *problem, const ca_real *u, const ca_real *f, ca_real *left);

/* Rounding error of Gamma f that counts as exact. */
ca_real ca_rounding(const ca_problem *problem, const ca_real *f);

/* Whether |u - Gamma f| is within a share of the tolerance, or of the rounding error of Gamma f. */
int ca_within(const ca_problem *problem, ca_real residual, ca_real tolerance, ca_real share,
              const ca_real *f);

/* Begin at the pseudo-inverse. */
void ca_start(const ca_problem *problem, const ca_real *u, int attainable, int *steps,
              ca_search *search);

/* Find least-norm thrusts. `ca_attempt` gives up early, and sets no thrusts then; `ca_least_norm`
 * continues from its multipliers. Both return whether |u - Gamma f| is within the tolerance. */
int ca_attempt(const ca_problem *problem, ca_search *search, ca_real *thrusts);
int ca_least_norm(const ca_problem *problem, ca_search *search, ca_real *thrusts);

/* The same for the wrench of a face; `ca_least_norm_at_once` for one on some planes of searches,
 * by one step towards all thrusts that are not held. If this does not suffice, it sets no
 * thrusts, and, if it finds another plane that touches the set, `unattainable` and the plane of
 * `next`. */
int ca_least_norm_at_once(const ca_problem *problem, const ca_face *face, int count,
                          const ca_real *const *toward, ca_real *thrusts, ca_search *next);
int ca_least_norm_on_face(const ca_problem *problem, const ca_face *face, ca_real *thrusts,
                          int *steps);

/* Remove the rounding error of u by the rotors between their bounds; the same result. */
int ca_settle(const ca_problem *problem, const ca_real *u, ca_real tolerance, ca_real *thrusts,
              int *steps);

#ifdef __cplusplus
}
#endif

#endif

/* Why thrusts produce another wrench than the demand. */
#ifndef CA_ROS_KERNEL_EXPLANATION_H
#define CA_ROS_KERNEL_EXPLANATION_H

#include "exact.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ca_explain CA_SYMBOL(ca_explain)

/* What limits a rotor, in `ca_explanation.limit`; negative at its lower bound. */
enum ca_limit {
    CA_NO_LIMIT = 0,
    CA_BY_BOUND = 1,  /* a bound of the set-up */
    CA_BY_RATE = 2,   /* a bound of `ca_set_bounds` */
    CA_BY_HEALTH = 3  /* the rotor is lost, or its health lowers its upper bound */
};

/* How a bound limits an axis, in `ca_explanation.blocks`. */
enum ca_blocking {
    CA_NO_BLOCK = 0,
    CA_ALONE = 1,    /* the axis comes nearer to its demand if this bound alone moves out */
    CA_TOGETHER = 2  /* only if all of these bounds move out together */
};

/* Why thrusts produce another wrench than u. A gain is by how much an axis comes nearer to its demand
 * per N by which a bound moves out, if the demand is served again; 0 if it depends on how far the
 * bound moves. An axis that misses its demand without a block is limited by the priorities: other axes
 * take what the bounds would give. If the policy is to reject, there are no blocks. */
typedef struct {
    ca_real margin;           /* that of u, see `ca_margin` */
    ca_real served[CA_M];     /* share of the way from the reference to its demand that each axis gets:
                                 1 less the size of its error over that of the way, at least 0 */
    int blocks[CA_M][CA_N];   /* enum ca_blocking of the rotors for each axis */
    ca_real gain[CA_M][CA_N]; /* gains of rotors that limit alone */
    ca_real joint_gain[CA_M]; /* gain of the bounds that limit only together, if all move alike */
    int airmode_blocks[CA_M]; /* enum ca_blocking of the limit on airmode for each axis */
    ca_real airmode[CA_M];    /* its gain, if it limits alone */
    int limit[CA_N];          /* enum ca_limit of each rotor */
} ca_explanation;

/* Explain thrusts[n], the result of `ca_allocate` for u[m]. This serves the demand again up to
 * (2 m + 4) n times: it is not for each call. */
void ca_explain(const ca_problem *problem, const ca_real *u, const ca_real *thrusts,
                ca_explanation *explanation);

#ifdef __cplusplus
}
#endif

#endif

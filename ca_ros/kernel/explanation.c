/* Why thrusts produce another wrench than the demand.
 *
 * A bound limits an axis if the axis comes nearer to its demand when the bound moves out. This is
 * tested, not derived: one bound after the other moves, and the wrench is served again. Multipliers
 * would take one solution alone, but they are not unique where more rotors are at their bounds than
 * decide, and they do not say that a more important axis takes what the bound gives.
 */
#include "explanation.h"
#include "numbers.h"
#include "priorities.h"

/* How far bounds move out, as shares of the reach of their rotors: twice, since a gain is stated only
 * if it is the same for both. */
#define NEAR CA_CHOOSE(1e-5, 1e-2)
#define FAR CA_CHOOSE(1e-3, 3e-2)
/* Least reach of a rotor, as a share of half of the range of its thrust. */
#define REACH_MIN CA_CHOOSE(1e-3, 1e-1)
/* Least gain that counts, and greatest relative difference of gains that are the same. */
#define GAIN_MIN CA_CHOOSE(1e-4, 1e-2)
#define SAME CA_CHOOSE(2e-3, 1e-2)
/* Residual that counts as none, as a share of half of the range of an axis. */
#define SERVED CA_CHOOSE(1e-9, 1e-4)
/* Distance of a thrust from its bound that counts as none, as a share of half of its range. */
#define AT_BOUND CA_CHOOSE(1e-9, 1e-4)

/* The upper and the lower bound of each rotor, and the limit on airmode. */
#define BOUNDS (2 * CA_N + 1)

typedef struct {
    const ca_problem *problem;
    const ca_real *u;
    ca_problem moved;
    ca_real longest;                   /* half of the greatest range of a thrust [N] */
    ca_real missed[CA_M];              /* what is missed with the bounds as they are */
    int count, rotor[BOUNDS], side[BOUNDS]; /* the bounds that may limit; side 0: that on airmode */
} trial;

/* Serve the demand with some bounds moved out. */
static void serve(trial *t, const int *chosen, ca_real distance, ca_served *served)
{
    const ca_problem *p = t->problem;
    ca_real lower[CA_N], upper[CA_N];
    int pivots = 0, steps = 0;
    ca_copy(CA_ROTORS(p), p->lower, lower);
    ca_copy(CA_ROTORS(p), p->upper, upper);
    t->moved.rise = p->rise;
    t->moved.later_rise = p->later_rise;
    for (int b = 0; b < t->count; b++) {
        if (!chosen[b])
            continue;
        if (t->side[b] > 0)
            upper[t->rotor[b]] += distance;
        else if (t->side[b] < 0)
            lower[t->rotor[b]] -= distance;
        else {
            t->moved.rise += distance / p->extent[p->thrust];
            t->moved.later_rise += distance / p->extent[p->thrust];
        }
    }
    ca_set_bounds(&t->moved, lower, upper);
    ca_prioritize(&t->moved, t->u, served, &pivots, &steps);
}

/* How far a bound may move: half of the range of the thrust now, or in all if the rotor is held. */
static ca_real reach(const trial *t, int b)
{
    const ca_problem *p = t->problem;
    const int i = t->rotor[b];
    if (!t->side[b])
        return p->extent[p->thrust];
    if (!(p->half_range[i] > 0))
        return t->longest;
    return ca_max((p->upper[i] - p->lower[i]) / 2, REACH_MIN * p->half_range[i]);
}

/* By how much each axis comes nearer to its demand per N by which all chosen bounds move. */
static void gains(trial *t, const int *chosen, ca_real share, ca_real *gain)
{
    ca_served served;
    ca_real distance = t->longest + t->problem->extent[0];
    for (int b = 0; b < t->count; b++)
        if (chosen[b])
            distance = ca_min(distance, reach(t, b));
    distance *= share;
    serve(t, chosen, distance, &served);
    for (int k = 0; k < CA_AXES(t->problem); k++)
        gain[k] = (ca_abs(t->missed[k]) - ca_abs(t->u[k] - served.face.wrench[k])) / distance;
}

static int counts(const trial *t, int k, ca_real gain)
{
    return gain * t->longest > GAIN_MIN * t->problem->extent[k];
}

/* The gain that is stated: none if it differs with the distance. */
static ca_real stated(ca_real near, ca_real far)
{
    return ca_abs(near - far) <= SAME * near ? near : 0;
}

/* Find the bounds that limit axis k only together: those without which the gain of all is smaller. */
static ca_real find_together(trial *t, int k, int *chosen)
{
    ca_real near[CA_M], far[CA_M], without[CA_M];
    gains(t, chosen, NEAR, near);
    if (!counts(t, k, near[k]))
        return -1;
    for (int b = 0; b < t->count; b++) {
        if (!chosen[b])
            continue;
        chosen[b] = 0;
        gains(t, chosen, NEAR, without);
        if (without[k] >= (1 - SAME) * near[k])
            near[k] = without[k];
        else
            chosen[b] = 1;
    }
    gains(t, chosen, FAR, far);
    return counts(t, k, far[k]) ? stated(near[k], far[k]) : -1;
}

static void name(const trial *t, int k, int b, int how, ca_explanation *e)
{
    const ca_problem *p = t->problem;
    const int i = t->rotor[b];
    if (!t->side[b]) {
        e->airmode_blocks[k] = how;
        return;
    }
    e->blocks[k][i] = how;
    if (t->side[b] < 0)
        e->limit[i] = p->lower[i] > p->least[i] ? -CA_BY_RATE : -CA_BY_BOUND;
    else if (p->upper[i] < p->most[i])
        e->limit[i] = CA_BY_RATE;
    else
        e->limit[i] = p->impaired[i] || !(p->half_range[i] > 0) ? CA_BY_HEALTH : CA_BY_BOUND;
}

/* Find what limits the axes that miss their demands. */
static void find_limits(trial *t, const int *misses, ca_explanation *e)
{
    ca_real near[BOUNDS][CA_M], far[BOUNDS][CA_M];
    int chosen[BOUNDS] = {0};
    for (int b = 0; b < t->count; b++) {
        chosen[b] = 1;
        gains(t, chosen, NEAR, near[b]);
        gains(t, chosen, FAR, far[b]);
        chosen[b] = 0;
    }
    for (int k = 0; k < CA_AXES(t->problem); k++) {
        int found = 0;
        for (int b = 0; misses[k] && b < t->count; b++) {
            /* What takes from the axis is not to move with the others. */
            chosen[b] = !counts(t, k, -near[b][k]);
            if (!counts(t, k, near[b][k]) || !counts(t, k, far[b][k]))
                continue;
            found = 1;
            name(t, k, b, CA_ALONE, e);
            if (t->side[b])
                e->gain[k][t->rotor[b]] = stated(near[b][k], far[b][k]);
            else
                e->airmode[k] = stated(near[b][k], far[b][k]);
        }
        if (!misses[k] || found)
            continue;
        const ca_real gain = find_together(t, k, chosen);
        if (gain < 0)
            continue;
        e->joint_gain[k] = gain;
        for (int b = 0; b < t->count; b++)
            if (chosen[b])
                name(t, k, b, CA_TOGETHER, e);
    }
}

static void add(trial *t, int rotor, int side)
{
    t->rotor[t->count] = rotor;
    t->side[t->count++] = side;
}

/* Note what is missed with the bounds as they are, and the bounds that may limit it. */
static void begin(trial *t, const ca_problem *p, const ca_real *u)
{
    ca_served served;
    t->problem = p;
    t->u = u;
    t->moved = *p;
    t->moved.widened = 1;
    t->count = 0;
    t->longest = 0;
    for (int i = 0; i < CA_ROTORS(p); i++)
        t->longest = ca_max(t->longest, p->half_range[i]);
    for (int i = 0; i < CA_ROTORS(p); i++) {
        if (p->lower[i] > p->least[i] || p->upper[i] < p->most[i])
            t->moved.widened = 0;
        /* These are no limits to bounds that move out. */
        t->moved.least[i] = -CA_ABSURD;
        t->moved.most[i] = CA_ABSURD;
        if (!(p->half_range[i] > 0))
            t->moved.half_range[i] = t->longest;
    }
    serve(t, 0, 0, &served);
    for (int k = 0; k < CA_AXES(p); k++)
        t->missed[k] = u[k] - served.face.wrench[k];
    for (int i = 0; i < CA_ROTORS(p); i++) {
        const ca_real f = served.face.thrusts[i];
        const ca_real rounding = AT_BOUND * t->moved.half_range[i];
        if (f >= p->upper[i] - rounding)
            add(t, i, 1);
        /* A rotor that is lost cannot give less. */
        if (f <= p->lower[i] + rounding && p->half_range[i] > 0)
            add(t, i, -1);
    }
    if (p->thrust >= 0 && p->later_rise < CA_UNBOUNDED)
        add(t, 0, 0);
}

void ca_explain(const ca_problem *p, const ca_real *u, const ca_real *thrusts,
                ca_explanation *explanation)
{
    const int m = CA_AXES(p);
    ca_real missed[CA_M];
    int misses[CA_M] = {0}, any = 0;
    trial t;
    memset(explanation, 0, sizeof *explanation);
    explanation->margin = -CA_UNBOUNDED;
    if (!ca_is_wrench(m, u))
        return;
    explanation->margin = ca_margin(p, u);
    ca_leave(p, u, thrusts, missed);
    for (int k = 0; k < m; k++)
        explanation->served[k] = 1;
    const ca_real size = ca_max(1, ca_length(m, u));
    if (ca_within(p, ca_length(m, missed), ca_max(CA_EXACT_TOLERANCE, p->slack) * size, 1, thrusts))
        return;
    for (int k = 0; k < m; k++) {
        const ca_real way = ca_abs(u[k] - p->reference[k]), error = ca_abs(missed[k]);
        misses[k] = error > ca_max(SERVED * p->extent[k], CA_EXACT_TOLERANCE * size);
        any = any || misses[k];
        if (misses[k])
            explanation->served[k] = error < way ? 1 - error / way : 0;
    }
    if (!any || p->policy == CA_REJECTED)
        return;
    begin(&t, p, u);
    find_limits(&t, misses, explanation);
}

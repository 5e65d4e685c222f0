/* Set-up, allocation, and the queries of exact.h. */
#include "exact.h"
#include "facet.h"
#include "numbers.h"

#include <string.h>

/* Share of an axis that is independent of the other axes, below which the set has no volume. */
#define SPANNING_MIN CA_CHOOSE(1e-9, 1e-5)

/* Orthonormal columns that span the rows of Gamma times the ranges of the thrusts, or over their
 * weights: Gamma^T = basis R by the Gram-Schmidt method, twice. Returns 0 if the rows are
 * dependent. */
static int span(ca_problem *p, int ranges)
{
    const int n = CA_ROTORS(p), m = CA_AXES(p);
    for (int k = 0; k < m; k++) {
        ca_real column[CA_N];
        for (int j = 0; j < m; j++)
            p->back[k][j] = 0;
        for (int i = 0; i < n; i++)
            column[i] = ranges ? p->gamma[k][i] * p->half_range[i] : p->gamma[k][i] / p->weight[i];
        const ca_real whole = ca_length(n, column);
        for (int round = 0; round < 2; round++)
            for (int j = 0; j < k; j++) {
                ca_real share = 0;
                for (int i = 0; i < n; i++)
                    share += p->basis[i][j] * column[i];
                p->back[k][j] += share;
                for (int i = 0; i < n; i++)
                    column[i] -= share * p->basis[i][j];
            }
        const ca_real rest = ca_length(n, column);
        if (!ca_is_finite(&rest) || !(rest > SPANNING_MIN * whole))
            return 0;
        p->back[k][k] = rest;
        for (int i = 0; i < n; i++)
            p->basis[i][k] = column[i] / rest;
        /* The inverse of the lower triangle `back`. */
        for (int j = 0; j <= k; j++) {
            ca_real sum = j == k ? 1 : 0;
            for (int i = j; i < k; i++)
                sum -= p->back[k][i] * p->coordinates[i][j];
            p->coordinates[k][j] = sum / rest;
        }
    }
    return 1;
}

static int order_is_sound(const ca_options *options, int m)
{
    int seen[CA_M] = {0};
    for (int i = 0; i < m; i++) {
        const int axis = options->order[i], before = i ? options->group[i - 1] : 0;
        if (axis < 0 || axis >= m || seen[axis])
            return 0;
        seen[axis] = 1;
        if (options->group[i] < before || options->group[i] > before + (i > 0))
            return 0;
    }
    return options->policy >= CA_PRIORITIZED && options->policy <= CA_REJECTED &&
           options->policy != CA_INEXACT;
}

static void bound(ca_problem *p, int i, ca_real lower, ca_real upper)
{
    p->lower[i] = p->deviation_lower[i] = lower;
    p->upper[i] = p->deviation_upper[i] = upper;
    if (!p->weighted)
        return;
    p->deviation_lower[i] = p->weight[i] * (lower - p->preferred[i]);
    p->deviation_upper[i] = p->weight[i] * (upper - p->preferred[i]);
}

/* Narrow the bounds of rotor i to the given ones, within those of the set-up. */
static inline void narrow_rotor(ca_problem *p, int i, ca_real low, ca_real high)
{
    const ca_real least = p->least[i], most = p->most[i];
    if (!(low >= least && high <= most)) {
        low = ca_clip(low, least, most);
        high = ca_clip(high, least, most);
    }
    bound(p, i, low, high);
}

int ca_set_bounds(ca_problem *p, const ca_real *lower, const ca_real *upper)
{
    for (int i = 0; i < CA_ROTORS(p); i++)
        if (!ca_is_finite(&lower[i]) || !ca_is_finite(&upper[i]) || lower[i] > upper[i])
            return CA_BAD_NUMBER;
    for (int i = 0; i < CA_ROTORS(p); i++)
        narrow_rotor(p, i, lower[i], upper[i]);
    return CA_SOUND;
}

/* Set the limits on airmode, scaled: the range of an axis is 2. Returns 0 if one is wrong. */
static int limit_airmode(ca_problem *p, const ca_options *options)
{
    ca_real *const limits[2] = {&p->rise, &p->later_rise};
    int first = 0, limited = 0;
    p->thrust = -1;
    for (int i = 0; i < 2; i++)
        *limits[i] = CA_UNBOUNDED;
    if (!options->airmode_limited || options->thrust < 0)
        return 1;
    /* In the first group thrust does not give way to others. */
    for (int i = 0; i < p->m; i++)
        first = first || (options->order[i] == options->thrust &&
                          options->group[i] == options->group[0]);
    for (int i = 0; i < 2; i++) {
        if (!ca_is_finite(&options->airmode[i]) || options->airmode[i] < 0)
            return 0;
        if (options->airmode[i] < 1 && !first) {
            *limits[i] = 2 * options->airmode[i];
            limited = 1;
        }
    }
    if (limited)
        p->thrust = options->thrust;
    return options->thrust < p->m && p->later_rise <= p->rise;
}

static int prepare(ca_problem *p, int n, int m, const ca_real *gamma, const ca_real *lower,
                   const ca_real *upper, const ca_options *options)
{
    ca_real most[CA_N] = {0};
    memset(p, 0, sizeof *p);
    if (n < 1 || n > CA_N || m < 1 || m > CA_M)
        return CA_BAD_SIZE;
    if (!order_is_sound(options, m))
        return CA_BAD_ORDER;
    p->n = n;
    p->m = m;
    if (CA_ROTORS(p) != n || CA_AXES(p) != m)
        return CA_BAD_SIZE;
    p->policy = options->policy;
    p->slack = options->slack;
    p->greatest = 1;
    if (!ca_is_finite(&p->slack) || p->slack < 0 || p->slack > 1 || !limit_airmode(p, options))
        return CA_BAD_NUMBER;
    for (int i = 0; i < n; i++) {
        if (!ca_is_finite(&lower[i]) || !ca_is_finite(&upper[i]) || lower[i] > upper[i])
            return CA_BAD_NUMBER;
        const ca_real weight = options->weighted ? options->weight[i] : 1;
        const ca_real preferred = options->weighted ? options->preferred[i] : 0;
        if (!ca_is_finite(&weight) || weight < 1 / CA_ABSURD || !ca_is_finite(&preferred))
            return CA_BAD_NUMBER;
        p->weighted = p->weighted || weight < 1 || weight > 1 || preferred < 0 || preferred > 0;
        p->weight[i] = weight;
        p->preferred[i] = preferred;
        p->least[i] = lower[i];
        p->most[i] = upper[i];
        p->impaired[i] = options->reports_health && options->impaired[i];
        bound(p, i, lower[i], upper[i]);
        const ca_real size = ca_max(ca_abs(p->deviation_lower[i]), ca_abs(p->deviation_upper[i]));
        if (!ca_is_finite(&size))
            return CA_BAD_NUMBER;
        p->middle[i] = (lower[i] + upper[i]) / 2;
        p->half_range[i] = (upper[i] - lower[i]) / 2;
        /* Its inverse has to be finite. */
        if (p->half_range[i] < 1 / CA_ABSURD)
            p->half_range[i] = 0;
        p->greatest = ca_max(p->greatest, size);
        most[i] = ca_max(ca_abs(lower[i]), ca_abs(upper[i]));
    }
    for (int k = 0; k < m; k++) {
        p->order[k] = options->order[k];
        p->group[k] = options->group[k];
        p->keep_sense[k] = options->keep_sense[k];
        p->reference[k] = options->reference[k];
        if (!ca_is_finite(&p->reference[k]))
            return CA_BAD_NUMBER;
        for (int i = 0; i < n; i++) {
            const ca_real entry = gamma[k * n + i];
            const ca_real weighed = entry / p->weight[i];
            if (!ca_is_finite(&entry) || !ca_is_finite(&weighed))
                return CA_BAD_NUMBER;
            p->gamma[k][i] = entry;
#ifdef CA_FLOAT
            p->refined = options->refined;
            p->nearly_level = options->refined && options->nearly_level;
            p->rest[k][i] = options->refined ? options->rest[k][i] : 0;
            /* A rest is no more than a rounding error. */
            if (!ca_is_finite(&p->rest[k][i]) ||
                ca_abs(p->rest[k][i]) > CA_REAL(1.2e-7) * ca_abs(entry))
                return CA_BAD_NUMBER;
#endif
            p->offset[k] += entry * p->preferred[i];
            p->center[k] += entry * p->middle[i];
            p->extent[k] += ca_abs(entry * p->half_range[i]);
        }
        if (p->extent[k] < 1 / CA_ABSURD)
            return CA_NO_VOLUME;
    }
    if (!span(p, 1) || !span(p, 0))
        return CA_NO_VOLUME;
    p->rounding = ca_rounding(p, most);
    ca_priorities_set_up(p, options->on_reference);
    return CA_SOUND;
}

int ca_set_up(ca_problem *p, int n, int m, const ca_real *gamma, const ca_real *lower,
              const ca_real *upper, const ca_options *options)
{
    const int fault = prepare(p, n, m, gamma, lower, upper, options);
    /* After an error the problem has no rotors and no axes. */
    if (fault)
        memset(p, 0, sizeof *p);
    return fault;
}

/* The thrusts within their bounds that are nearest to zero. */
static void rest(const ca_problem *p, ca_real *thrusts)
{
    for (int i = 0; i < CA_ROTORS(p); i++)
        thrusts[i] = ca_clip(0, p->lower[i], p->upper[i]);
}

/* Whether thrusts produce u. */
static int produce(const ca_problem *p, const ca_search *search, const ca_real *thrusts)
{
    ca_real missed[CA_M];
    ca_leave(p, search->wrench, thrusts, missed);
    return ca_within(p, ca_length(CA_AXES(p), missed), search->tolerance, 1, thrusts);
}

/* The thrusts of the simplex method, if not with the least norm: rotors without effect are. */
static void take(const ca_problem *p, const ca_face *face, ca_real *thrusts)
{
    for (int i = 0; i < CA_ROTORS(p); i++) {
        ca_real effect = 0;
        for (int k = 0; k < CA_AXES(p); k++)
            effect += ca_abs(p->gamma[k][i]);
        thrusts[i] =
            effect > 0 ? face->thrusts[i] : ca_clip(p->preferred[i], p->lower[i], p->upper[i]);
    }
}

/* Least-norm thrusts for a served wrench on its face. */
static int thrusts_on(const ca_problem *p, const ca_served *served, ca_real *thrusts, int *steps)
{
    if (!served->least)
        return ca_least_norm_on_face(p, &served->face, thrusts, steps);
    ca_search search;
    ca_start(p, served->face.wrench, 1, steps, &search);
    ca_copy(CA_ROTORS(p), served->face.thrusts, thrusts);
    return produce(p, &search, thrusts);
}

/* Find thrusts for u if nothing has proven yet that it is not attainable. Whether it counts as
 * attainable depends on u alone and not on the policy, whose wrench may be `served` instead. */
static int insist(const ca_problem *p, ca_search *search, const ca_served *served, int on_face,
                  ca_real *thrusts)
{
    ca_real missed[CA_M];
    if (on_face && served->reached &&
        ca_settle(p, search->wrench, search->tolerance, thrusts, search->steps))
        return 1;
    if (ca_least_norm(p, search, thrusts))
        return 1;
    /* Newton's method can stall near almost parallel facets. */
    ca_leave(p, search->wrench, thrusts, missed);
    if (!search->unattainable && ca_length(CA_AXES(p), missed) <= p->slack * search->size)
        return 1;
    take(p, &served->face, thrusts);
    return produce(p, search, thrusts);
}

/* The policy, or CA_RATE_LIMITED if a thrust is held by a bound that `ca_set_bounds` has narrowed. */
static int unattainable_status(const ca_problem *p, const ca_face *face)
{
    for (int i = 0; p->policy != CA_REJECTED && i < CA_ROTORS(p); i++) {
        const ca_real f = face->thrusts[i], lower = p->lower[i], upper = p->upper[i];
        if (face->held[i] && ((upper < p->most[i] && upper - f <= f - lower) ||
                              (lower > p->least[i] && upper - f >= f - lower)))
            return CA_RATE_LIMITED;
    }
    return p->policy;
}

/* Returns the answer for u; if it is rejected, the thrusts are not set. */
static ca_answer solve(const ca_problem *p, const ca_real *u, ca_real *thrusts)
{
    ca_answer answer = {CA_EXACT, 1, 0, 0};
    ca_search search, other;
    ca_start(p, u, 0, &answer.steps, &search);
    if (ca_attempt(p, &search, thrusts))
        return answer;

    ca_served served;
    memset(&served, 0, sizeof served);
    if (search.unattainable && p->policy != CA_REJECTED &&
        ca_serve_at_planes(p, &search, &served, thrusts, &answer.pivots)) {
        if (!served.reached || !produce(p, &search, thrusts)) {
            answer.status = unattainable_status(p, &served.face);
            answer.level = served.level;
        }
        return answer;
    }
    ca_prioritize(p, u, &served, &answer.pivots, &answer.steps);
    const int on_face = !served.almost_parallel && (served.unique || !served.reached);
    int found = 0;
    if (on_face && (served.reached || p->policy != CA_REJECTED)) {
        found = thrusts_on(p, &served, thrusts, &answer.steps);
        if (produce(p, &search, thrusts))
            return answer;
    }
    if (!search.unattainable) {
        ca_real least[CA_N];
        ca_copy(CA_ROTORS(p), thrusts, least);
        if (insist(p, &search, &served, on_face, least)) {
            ca_copy(CA_ROTORS(p), least, thrusts);
            return answer;
        }
    }
    answer.status = unattainable_status(p, &served.face);
    answer.level = served.level;
    if (p->policy == CA_REJECTED) {
        answer.level = 0;
        return answer;
    }
    ca_start(p, served.face.wrench, 1, &answer.steps, &other);
    if (!on_face)
        found = ca_least_norm(p, &other, thrusts);
    if (!found) {
        take(p, &served.face, thrusts);
        if (!produce(p, &other, thrusts))
            answer.status = CA_INEXACT;
    }
    return answer;
}

ca_answer ca_allocate(const ca_problem *p, const ca_real *u, ca_real *thrusts)
{
    ca_answer answer = {CA_INVALID, 0, 0, 0};
    if (ca_is_wrench(CA_AXES(p), u))
        answer = solve(p, u, thrusts);
    if (answer.status == CA_INVALID || answer.status == CA_REJECTED)
        rest(p, thrusts);
    return answer;
}

void ca_speeds(int n, const ca_real *thrusts, const ca_real *thrust_coefficient,
               const ca_real *reverse_coefficient, const ca_real *speed_min,
               const ca_real *speed_max, ca_real *speeds)
{
    for (int i = 0; i < n; i++) {
        const ca_real f = thrusts[i];
        const ca_real speed = f > 0   ? ca_sqrt(f / thrust_coefficient[i])
                              : f < 0 ? -ca_sqrt(-f / reverse_coefficient[i])
                                      : 0;
        speeds[i] = ca_clip(speed, speed_min[i], speed_max[i]);
    }
}

/* The least speed that a rotor reaches from a positive one. */
static ca_real slowed(ca_real speed, ca_real time, ca_real up, ca_real down)
{
    const ca_real change = down * time;
    return change <= speed ? speed - change : -up * (time - speed / down);
}

/* The least and greatest speeds that a rotor reaches. */
static inline void reach(const ca_real *from, ca_real time, ca_real up, ca_real down, ca_real speed_min,
                         ca_real speed_max, ca_real *least, ca_real *greatest)
{
    const ca_real rise = up * time, drop = down * time;
    ca_real speed = ca_is_finite(from) ? *from : speed_min;
    if (speed < speed_min || speed > speed_max)
        speed = ca_clip(speed, speed_min, speed_max);
    ca_real low = speed - drop, high = speed + rise;
    /* Few rotors turn backwards, or stop within the time. */
    if (speed < drop) {
        low = speed > 0 ? slowed(speed, time, up, down) : speed - rise;
        high = speed < 0 ? -slowed(-speed, time, up, down) : high;
    }
    *least = ca_max(low, speed_min);
    *greatest = ca_min(high, speed_max);
}

static inline ca_real thrust(ca_real speed, ca_real coefficient, ca_real reverse)
{
    const ca_real square = speed * speed;
    return speed < 0 ? -(reverse * square) : coefficient * square;
}

void ca_reach(int n, const ca_real *speeds, ca_real time, const ca_real *up, const ca_real *down,
              const ca_real *speed_min, const ca_real *speed_max, ca_real *least,
              ca_real *greatest)
{
    for (int i = 0; i < n; i++)
        reach(&speeds[i], time, up[i], down[i], speed_min[i], speed_max[i], &least[i],
              &greatest[i]);
}

void ca_narrow(ca_problem *p, const ca_real *speeds, ca_real time, const ca_real *up,
               const ca_real *down, const ca_real *thrust_coefficient,
               const ca_real *reverse_coefficient, const ca_real *speed_min,
               const ca_real *speed_max, ca_real *least, ca_real *greatest)
{
    for (int i = 0; i < CA_ROTORS(p); i++) {
        const ca_real forwards = thrust_coefficient[i];
        ca_real low, high;
        reach(&speeds[i], time, up[i], down[i], speed_min[i], speed_max[i], &low, &high);
        if (low >= 0)
            narrow_rotor(p, i, forwards * (low * low), forwards * (high * high));
        else
            narrow_rotor(p, i, thrust(low, forwards, reverse_coefficient[i]),
                   thrust(high, forwards, reverse_coefficient[i]));
        least[i] = low;
        greatest[i] = high;
    }
}

void ca_thrusts(int n, const ca_real *speeds, const ca_real *thrust_coefficient,
                const ca_real *reverse_coefficient, ca_real *thrusts)
{
    for (int i = 0; i < n; i++)
        thrusts[i] = thrust(speeds[i], thrust_coefficient[i], reverse_coefficient[i]);
}

/* Half of the range of a thrust within the bounds of `ca_set_bounds`. */
static ca_real half_range(const ca_problem *p, int i)
{
    return (p->upper[i] - p->lower[i]) / 2;
}

/* A unit vector normal to m - 1 columns of Gamma, by elimination with full pivoting. Returns 0 if
 * the columns are dependent. */
static int normal_of(const ca_problem *p, const int *choice, ca_real *normal)
{
    const int m = CA_AXES(p);
    ca_real rows[CA_M][CA_M];
    int axis[CA_M];
    for (int k = 0; k < m; k++)
        axis[k] = k;
    for (int r = 0; r < m - 1; r++) {
        const ca_real half = half_range(p, choice[r]);
        for (int k = 0; k < m; k++)
            rows[r][k] = p->gamma[k][choice[r]] * half / p->extent[k];
        const ca_real length = ca_length(m, rows[r]);
        if (!(length > 0))
            return 0;
        for (int k = 0; k < m; k++)
            rows[r][k] /= length;
    }
    for (int r = 0; r < m - 1; r++) {
        int row = r, column = r;
        for (int i = r; i < m - 1; i++)
            for (int k = r; k < m; k++)
                if (ca_abs(rows[i][k]) > ca_abs(rows[row][column])) {
                    row = i;
                    column = k;
                }
        if (!(ca_abs(rows[row][column]) > SPANNING_MIN))
            return 0;
        for (int k = 0; k < m; k++) {
            const ca_real entry = rows[r][k];
            rows[r][k] = rows[row][k];
            rows[row][k] = entry;
        }
        for (int i = 0; i < m - 1; i++) {
            const ca_real entry = rows[i][r];
            rows[i][r] = rows[i][column];
            rows[i][column] = entry;
        }
        const int moved = axis[r];
        axis[r] = axis[column];
        axis[column] = moved;
        for (int i = r + 1; i < m - 1; i++) {
            const ca_real factor = rows[i][r] / rows[r][r];
            for (int k = r; k < m; k++)
                rows[i][k] -= factor * rows[r][k];
        }
    }
    ca_real solution[CA_M];
    solution[m - 1] = 1;
    for (int r = m - 2; r >= 0; r--) {
        ca_real sum = 0;
        for (int k = r + 1; k < m; k++)
            sum -= rows[r][k] * solution[k];
        solution[r] = sum / rows[r][r];
    }
    /* Back to the units of the wrench. */
    for (int k = 0; k < m; k++)
        normal[axis[k]] = solution[k] / p->extent[axis[k]];
    const ca_real length = ca_length(m, normal);
    for (int k = 0; k < m; k++)
        normal[k] /= length;
    return 1;
}

/* Half of the size of the admissible set along a normal. */
static ca_real half_width(const ca_problem *p, const ca_real *normal)
{
    ca_real width = 0;
    for (int i = 0; i < CA_ROTORS(p); i++) {
        ca_real side = 0;
        for (int k = 0; k < CA_AXES(p); k++)
            side += normal[k] * p->gamma[k][i];
        width += ca_abs(side) * half_range(p, i);
    }
    return width;
}

/* The next choice of `size` of n rotors in lexicographic order; returns 0 after the last. */
static int next_choice(int n, int size, int *choice)
{
    int r = size - 1;
    while (r >= 0 && choice[r] == n - size + r)
        r--;
    if (r < 0)
        return 0;
    choice[r]++;
    for (int i = r + 1; i < size; i++)
        choice[i] = choice[i - 1] + 1;
    return 1;
}

ca_real ca_margin(const ca_problem *p, const ca_real *u)
{
    const int n = CA_ROTORS(p), m = CA_AXES(p), size = m - 1;
    int choice[CA_M], normals = 0;
    ca_real margin = CA_UNBOUNDED, center[CA_M] = {0}, extent[CA_M] = {0};
    if (n < size)
        return -CA_UNBOUNDED;
    for (int k = 0; k < m; k++)
        for (int i = 0; i < n; i++) {
            center[k] += p->gamma[k][i] * ((p->lower[i] + p->upper[i]) / 2);
            extent[k] += ca_abs(p->gamma[k][i]) * half_range(p, i);
        }
    for (int r = 0; r < size; r++)
        choice[r] = r;
    do {
        ca_real normal[CA_M], height = 0, whole = 0;
        if (!normal_of(p, choice, normal))
            continue;
        for (int k = 0; k < m; k++) {
            height += normal[k] * (u[k] - center[k]);
            whole += ca_abs(normal[k]) * extent[k];
        }
        const ca_real width = half_width(p, normal);
        if (!(width > SPANNING_MIN * whole))
            return -CA_UNBOUNDED;
        margin = ca_min(margin, width - ca_abs(height));
        normals++;
    } while (next_choice(n, size, choice));
    return normals ? margin : -CA_UNBOUNDED;
}

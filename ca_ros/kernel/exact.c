/* Set-up, allocation, and the queries of exact.h. */
#include "numbers.h"

/* Share of an axis that is independent of the other axes, below which the set has no volume. */
#define INDEPENDENT CA_CHOOSE(1e-9, 1e-5)

static int is_finite(ca_real x)
{
    return ca_abs(x) <= CA_ABSURD;
}

/* Orthonormal columns that span the rows of Gamma, or of Gamma times the ranges of the thrusts:
 * Gamma^T = basis R by the Gram-Schmidt method, twice. Returns 0 if the rows are dependent. */
static int span(ca_problem *p, int ranges)
{
    const int n = CA_ROTORS(p), m = CA_AXES(p);
    for (int k = 0; k < m; k++) {
        ca_real column[CA_N];
        for (int j = 0; j < m; j++)
            p->back[k][j] = 0;
        for (int i = 0; i < n; i++)
            column[i] = p->gamma[k][i] * (ranges ? p->half_range[i] : 1);
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
        if (!(rest > INDEPENDENT * whole))
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

static int prepare(ca_problem *p, int n, int m, const ca_real *gamma, const ca_real *lower,
                   const ca_real *upper, const ca_options *options)
{
    *p = (ca_problem){0};
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
    if (!(p->slack >= 0 && p->slack <= 1))
        return CA_BAD_NUMBER;
    for (int i = 0; i < n; i++) {
        if (!is_finite(lower[i]) || !is_finite(upper[i]) || lower[i] > upper[i])
            return CA_BAD_NUMBER;
        const ca_real weight = options->weighted ? options->weight[i] : 1;
        const ca_real preferred = options->weighted ? options->preferred[i] : 0;
        if (!(weight > 0) || !is_finite(weight) || !is_finite(1 / weight) || !is_finite(preferred))
            return CA_BAD_NUMBER;
        p->weighted = p->weighted || weight < 1 || weight > 1 || preferred < 0 || preferred > 0;
        p->weight[i] = weight;
        p->preferred[i] = preferred;
        p->thrust_lower[i] = lower[i];
        p->thrust_upper[i] = upper[i];
        p->lower[i] = weight * (lower[i] - preferred);
        p->upper[i] = weight * (upper[i] - preferred);
        if (!is_finite(p->lower[i]) || !is_finite(p->upper[i]))
            return CA_BAD_NUMBER;
        p->middle[i] = (p->lower[i] + p->upper[i]) / 2;
        p->half_range[i] = (p->upper[i] - p->lower[i]) / 2;
        p->greatest = ca_max(p->greatest, ca_max(ca_abs(p->lower[i]), ca_abs(p->upper[i])));
    }
    for (int k = 0; k < m; k++) {
        p->order[k] = options->order[k];
        p->group[k] = options->group[k];
        p->keep_sense[k] = options->keep_sense[k];
        p->reference[k] = options->reference[k];
        if (!is_finite(p->reference[k]))
            return CA_BAD_NUMBER;
        for (int i = 0; i < n; i++) {
            const ca_real entry = gamma[k * n + i];
            if (!is_finite(entry))
                return CA_BAD_NUMBER;
            p->gamma[k][i] = entry / p->weight[i];
            if (!is_finite(p->gamma[k][i]))
                return CA_BAD_NUMBER;
            p->offset[k] += entry * p->preferred[i];
            p->center[k] += p->gamma[k][i] * p->middle[i];
            p->extent[k] += ca_abs(p->gamma[k][i] * p->half_range[i]);
        }
        p->reference[k] -= p->offset[k];
        if (!(p->extent[k] > 0))
            return CA_NO_VOLUME;
    }
    if (!span(p, 1) || !span(p, 0))
        return CA_NO_VOLUME;
    ca_priorities_set_up(p, options->on_reference);
    return CA_SOUND;
}

int ca_set_up(ca_problem *p, int n, int m, const ca_real *gamma, const ca_real *lower,
              const ca_real *upper, const ca_options *options)
{
    const int fault = prepare(p, n, m, gamma, lower, upper, options);
    /* After an error the problem has no rotors and no axes. */
    if (fault)
        *p = (ca_problem){0};
    return fault;
}

/* The thrusts within their bounds that are nearest to zero. */
static void rest(const ca_problem *p, ca_real *thrusts)
{
    for (int i = 0; i < CA_ROTORS(p); i++)
        thrusts[i] = ca_clip(0, p->thrust_lower[i], p->thrust_upper[i]);
}

/* Thrusts of g = weight (f - preferred), in place. */
static void unweight(const ca_problem *p, ca_real *thrusts)
{
    for (int i = 0; i < CA_ROTORS(p); i++) {
        const ca_real g = thrusts[i], f = p->preferred[i] + g / p->weight[i];
        thrusts[i] = g <= p->lower[i]   ? p->thrust_lower[i]
                     : g >= p->upper[i] ? p->thrust_upper[i]
                                        : ca_clip(f, p->thrust_lower[i], p->thrust_upper[i]);
    }
}

/* Allocate in the units of the prepared problem, with a residual relative to `size`. If u is
 * rejected, the thrusts are not set. */
static ca_answer solve(const ca_problem *p, const ca_real *u, ca_real size, ca_real *thrusts)
{
    const int n = CA_ROTORS(p), m = CA_AXES(p);
    const ca_real tolerance = CA_TOLERANCE * size;
    ca_answer answer = {CA_EXACT, 1, 0, 0};
    ca_real missed[CA_M] = {0}, y[CA_M] = {0};
    if (ca_attempt(p, u, tolerance, thrusts, y, &answer.steps) <= tolerance)
        return answer;

    ca_served served = {0};
    ca_prioritize(p, u, &served, &answer.pivots, &answer.steps);
    const ca_real goal = CA_TOLERANCE * ca_max(1, ca_length(m, served.wrench));
    ca_real residual = CA_INFINITY;
    const int on_face = !served.almost_parallel && (served.unique || !served.reached);
    if (on_face && (served.reached || p->policy != CA_REJECTED)) {
        residual = ca_least_norm_on_face(p, &served, goal, thrusts, &answer.steps);
        ca_leave(p, u, thrusts, missed);
        if (ca_length(m, missed) <= tolerance)
            return answer;
    }
    if (served.reached) {
        /* u is attainable according to the simplex method, but the thrusts miss it. */
        ca_real least[CA_N], left;
        ca_copy(n, thrusts, least);
        left = on_face ? ca_settle(p, u, tolerance, least, &answer.steps)
                       : ca_least_norm(p, u, tolerance, 1, least, y, &answer.steps);
        for (int k = 0; k < m; k++)
            missed[k] = served.wrench[k] - u[k];
        if (left <= tolerance || (ca_length(m, missed) <= tolerance && left <= p->slack * size)) {
            ca_copy(n, least, thrusts);
            return answer;
        }
    }
    answer.status = p->policy;
    answer.level = served.level;
    if (p->policy == CA_REJECTED) {
        answer.level = 0;
        return answer;
    }
    if (!on_face)
        residual = ca_least_norm(p, served.wrench, goal, 0, thrusts, y, &answer.steps);
    if (!(residual <= goal)) {
        /* The thrusts of the simplex method produce the wrench too, if not with the least norm. */
        ca_copy(n, served.thrusts, thrusts);
        ca_leave(p, served.wrench, thrusts, missed);
        if (!(ca_length(m, missed) <= goal))
            answer.status = CA_INEXACT;
        ca_leave(p, u, thrusts, missed);
        if (ca_length(m, missed) <= tolerance) {
            answer.status = CA_EXACT;
            answer.level = 1;
        }
    }
    return answer;
}

ca_answer ca_allocate(const ca_problem *p, const ca_real *u, ca_real *thrusts)
{
    const int m = CA_AXES(p);
    ca_answer answer = {CA_INVALID, 0, 0, 0};
    ca_real length = 0;
    for (int k = 0; k < m && length <= CA_ABSURD; k++)
        length = is_finite(u[k]) ? ca_max(length, ca_abs(u[k])) : CA_INFINITY;
    length = length <= CA_ABSURD ? ca_length(m, u) : length;
    if (length <= CA_ABSURD) {
        const ca_real size = ca_max(1, length);
        if (!p->weighted) {
            answer = solve(p, u, size, thrusts);
        } else {
            ca_real shifted[CA_M];
            for (int k = 0; k < m; k++)
                shifted[k] = u[k] - p->offset[k];
            answer = solve(p, shifted, size, thrusts);
            if (answer.status != CA_REJECTED)
                unweight(p, thrusts);
        }
    }
    if (answer.status == CA_INVALID || answer.status == CA_REJECTED)
        rest(p, thrusts);
    return answer;
}

void ca_leave(const ca_problem *p, const ca_real *u, const ca_real *f, ca_real *left)
{
    for (int k = 0; k < CA_AXES(p); k++)
        left[k] = u[k] - ca_dot(CA_ROTORS(p), p->gamma[k], f);
}

void ca_residual(const ca_problem *p, const ca_real *u, const ca_real *thrusts, ca_real *residual)
{
    ca_real shifted[CA_M], g[CA_N];
    if (!p->weighted) {
        ca_leave(p, u, thrusts, residual);
        return;
    }
    for (int k = 0; k < CA_AXES(p); k++)
        shifted[k] = u[k] - p->offset[k];
    for (int i = 0; i < CA_ROTORS(p); i++)
        g[i] = p->weight[i] * (thrusts[i] - p->preferred[i]);
    ca_leave(p, shifted, g, residual);
}

void ca_active_set(const ca_problem *p, const ca_real *thrusts, signed char *active)
{
    for (int i = 0; i < CA_ROTORS(p); i++) {
        const ca_real low = CA_TOLERANCE * ca_max(1, ca_abs(p->thrust_lower[i]));
        const ca_real high = CA_TOLERANCE * ca_max(1, ca_abs(p->thrust_upper[i]));
        active[i] = thrusts[i] <= p->thrust_lower[i] + low ? -1 : thrusts[i] >= p->thrust_upper[i] - high ? 1 : 0;
    }
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
        for (int k = 0; k < m; k++)
            rows[r][k] = p->gamma[k][choice[r]] * p->half_range[choice[r]] / p->extent[k];
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
        if (!(ca_abs(rows[row][column]) > INDEPENDENT))
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

ca_real ca_margin(const ca_problem *p, const ca_real *u)
{
    const int n = CA_ROTORS(p), m = CA_AXES(p), size = m - 1;
    int choice[CA_M];
    ca_real margin = CA_INFINITY;
    if (n < size)
        return -CA_INFINITY;
    for (int r = 0; r < size; r++)
        choice[r] = r;
    for (;;) {
        ca_real normal[CA_M], height = 0, width = 0;
        if (normal_of(p, choice, normal)) {
            for (int k = 0; k < m; k++)
                height += normal[k] * (u[k] - p->offset[k] - p->center[k]);
            for (int i = 0; i < n; i++) {
                ca_real side = 0;
                for (int k = 0; k < m; k++)
                    side += normal[k] * p->gamma[k][i];
                width += ca_abs(side) * p->half_range[i];
            }
            margin = ca_min(margin, width - ca_abs(height));
        }
        /* The next choice in lexicographic order. */
        int r = size - 1;
        while (r >= 0 && choice[r] == n - size + r)
            r--;
        if (r < 0)
            return margin;
        choice[r]++;
        for (int i = r + 1; i < size; i++)
            choice[i] = choice[i - 1] + 1;
    }
}

/* The kernel for the page: one vehicle, its attainable set, and other methods beside `exact`.
 *
 * The page writes numbers, calls a function, and reads numbers. Rows are axes, columns rotors.
 */
#include "explanation.h"
#include "exact.c" /* for span, normal_of, half_width and next_choice */

#define SHARED __attribute__((visibility("default")))
/* A variable, or a part of one, that the page finds by its name. */
#define PART(type, name, place) SHARED type *const type##_##name = (type *)&place;
#define FIELD(type, name, dimensions) static type name dimensions; PART(type, name, name)
#define FACETS 8192
#define INDEPENDENCE_MIN 0.05
#define SEGMENTS 256

enum method { EXACT, CLIPPED, COMPUTED_ONCE, ALL_AXES };

/* What the page writes: a vehicle, the case, and a demand. */
FIELD(int, n, ) FIELD(int, m, )
FIELD(int, axis, [CA_M]) /* places among force_x, force_y, thrust, roll, pitch, yaw */
FIELD(ca_real, gamma, [CA_M * CA_N])
FIELD(ca_real, lower, [CA_N]) FIELD(ca_real, upper, [CA_N])
FIELD(ca_real, forward, [CA_N]) FIELD(ca_real, reverse, [CA_N])
FIELD(ca_real, speed_min, [CA_N]) FIELD(ca_real, speed_max, [CA_N])
FIELD(ca_real, acceleration, [CA_N]) FIELD(ca_real, deceleration, [CA_N])
/* A thrust curve: start, a, b and c of its segments, for rotors with a k_f of `unit`. */
FIELD(int, segments, ) FIELD(ca_real, segment, [SEGMENTS][4]) FIELD(ca_real, unit, )
FIELD(ca_real, elapsed, ) /* time since hover; 0: any time */
FIELD(ca_real, hover, [CA_M]) FIELD(ca_real, demand, [CA_M])
FIELD(ca_real, asked, [CA_M]) /* the demand of all axes, also of those that `audit` gives up */
static ca_options options = {.airmode_limited = 1, .reports_health = 1};
PART(int, policy, options.policy) PART(int, order, options.order)
PART(int, group, options.group) PART(int, keep_sense, options.keep_sense)
PART(int, weighted, options.weighted) PART(ca_real, weight, options.weight)
PART(ca_real, preferred, options.preferred) PART(ca_real, slack, options.slack)
PART(int, impaired, options.impaired) PART(int, thrust, options.thrust)
PART(ca_real, airmode, options.airmode)

/* What it reads. */
FIELD(int, facets, ) /* pairs of parallel facets at their width from the middle; -1: too many */
FIELD(ca_real, normal, [FACETS][CA_M]) FIELD(ca_real, width, [FACETS])
FIELD(int, status, ) FIELD(ca_real, level, )
FIELD(ca_real, thrusts, [CA_N]) FIELD(ca_real, speeds, [CA_N]) FIELD(int, saturation, [CA_N])
FIELD(ca_real, margin, ) FIELD(int, limit, [CA_N]) /* rotors at the nearest facet */
static ca_explanation why;
PART(int, cause, why.limit) PART(ca_real, served, why.served)
PART(int, blocks, why.blocks) PART(int, airmode_blocks, why.airmode_blocks)

static ca_problem problem, current, once; /* `current` without lost rotors, `once` with them */
static ca_problem all_axes; /* of the axes before `audit` gave some up; m is 0 if it has no inverse */
PART(ca_real, middle, current.center)

static void speeds_of(const ca_real *f, ca_real *w)
{
    if (!segments)
        ca_speeds(n, f, forward, reverse, speed_min, speed_max, w);
    for (int i = 0; segments && i < n; i++) {
        const ca_real thrust = unit * (ca_max(f[i], 0) / forward[i]);
        int s = segments - 1;
        while (s > 0 && thrust < ca_curve(segments, segment, segment[s][0]))
            s--;
        const ca_real a = segment[s][1], b = segment[s][2], rest = thrust - segment[s][3];
        const ca_real r = ca_sqrt(ca_max(b * b + 4 * a * rest, 0));
        const ca_real top = b >= 0 ? 2 * rest : r - b, bottom = b >= 0 ? b + r : 2 * a;
        w[i] = ca_clip(bottom > 0 || bottom < 0 ? top / bottom : 0, speed_min[i], speed_max[i]);
    }
}

/* The result may overwrite the speeds. */
static void thrusts_of(const ca_real *w, ca_real *f)
{
    if (!segments)
        ca_thrusts(n, w, forward, reverse, f);
    for (int i = 0; segments && i < n; i++)
        f[i] = forward[i] / unit * ca_curve(segments, segment, ca_max(w[i], 0));
}

/* Whether the axes, without one more, are independent: the column of an axis in the pseudo-inverse
 * has the inverse of the distance of its row from the span of the others as length. */
static int independent(int without)
{
    static ca_problem part;
    part.n = n;
    part.m = 0;
    for (int i = 0; i < n; i++)
        part.half_range[i] = (upper[i] - lower[i]) / 2;
    for (int k = 0; k < m; k++)
        if (k != without)
            ca_copy(n, &gamma[k * n], part.gamma[part.m++]);
    if (!span(&part, 1))
        return 0;
    for (int k = 0; k < part.m; k++) {
        ca_real row = 0, column = 0;
        for (int i = 0; i < n; i++)
            row += part.gamma[k][i] * part.half_range[i] * part.gamma[k][i] * part.half_range[i];
        for (int j = k; j < part.m; j++)
            column += part.coordinates[j][k] * part.coordinates[j][k];
        if (!(row * column <= 1 / (INDEPENDENCE_MIN * INDEPENDENCE_MIN)))
            return 0;
    }
    return 1;
}

/* Set up a problem for the other methods, with the columns of lost rotors or without. */
static int set_up(ca_problem *made, int columns)
{
    ca_options plain = {.policy = CA_REJECTED, .thrust = -1, .slack = options.slack};
    ca_real matrix[CA_M * CA_N];
    for (int i = 0; i < m * n; i++)
        matrix[i] = columns || upper[i % n] > lower[i % n] ? gamma[i] : 0;
    for (int k = 0; k < m; k++)
        plain.order[k] = k;
    return ca_set_up(made, n, m, matrix, lower, upper, &plain);
}

/* Give axes up until the others are independent, as `ca_ros.problem.audit` does: the first that
 * suffices, or else the first. */
SHARED void audit(void)
{
    static const int last_to_first[] = {3, 4, 5, 0, 1};
    if (set_up(&all_axes, 0))
        all_axes.m = 0;
    while (!independent(-1)) {
        int gone = -1, suffices = 0;
        for (int e = 0; e < 5; e++)
            for (int k = 0; k < m; k++)
                if (axis[k] == last_to_first[e] && (independent(k) || !suffices)) {
                    suffices = independent(k);
                    gone = k;
                }
        if (gone < 0)
            return;
        m--;
        for (int k = gone; k < m; k++) {
            axis[k] = axis[k + 1];
            ca_copy(n, &gamma[(k + 1) * n], &gamma[k * n]);
        }
    }
}

static void find_facets(void)
{
    int choice[CA_M];
    for (int r = 0; r < m; r++)
        choice[r] = r;
    facets = 0;
    do {
        if (facets == FACETS) {
            facets = -1;
            return;
        }
        ca_real *found = normal[facets];
        if (!normal_of(&current, choice, found))
            continue;
        int known = 0;
        for (int f = 0; f < facets && !known; f++) {
            ca_real same = 0, other = 0;
            for (int k = 0; k < m; k++) {
                same = ca_max(same, ca_abs(found[k] - normal[f][k]));
                other = ca_max(other, ca_abs(found[k] + normal[f][k]));
            }
            known = ca_min(same, other) < 1e-9;
        }
        width[facets] = half_width(&current, found);
        facets += !known;
    } while (next_choice(n, m - 1, choice));
}

/* The distance of a wrench from the nearest facet, and the rotors at their bounds there. */
static void find_margin(const ca_real *u)
{
    int nearest = 0;
    ca_real side = 1;
    margin = CA_UNBOUNDED;
    for (int f = 0; f < facets; f++) {
        ca_real height = 0;
        for (int k = 0; k < m; k++)
            height += normal[f][k] * (u[k] - current.center[k]);
        if (width[f] - ca_abs(height) < margin) {
            margin = width[f] - ca_abs(height);
            nearest = f;
            side = height < 0 ? -1 : 1;
        }
    }
    for (int i = 0; i < n; i++) {
        ca_real sum = 0, size = 0;
        for (int k = 0; k < m; k++) {
            sum += side * normal[nearest][k] * current.gamma[k][i];
            size += ca_abs(normal[nearest][k] * current.gamma[k][i]);
        }
        const int at_bound = facets > 0 && upper[i] > lower[i] && ca_abs(sum) > 1e-10 * size;
        limit[i] = at_bound ? (sum > 0) - (sum < 0) : 0;
    }
}

/* No axis can be controlled: the rotors are as slow as possible. */
static int powerless(int fault)
{
    m = facets = 0;
    return fault;
}

/* Narrow the bounds to what the rotors reach from hover in the time that has elapsed. */
static void narrow_to_reach(void)
{
    ca_real least[CA_N], most[CA_N], now[CA_N];
    ca_allocate(&problem, hover, now);
    speeds_of(now, now);
    ca_reach(n, now, elapsed, acceleration, deceleration, speed_min, speed_max, least, most);
    thrusts_of(least, least);
    thrusts_of(most, most);
    ca_set_bounds(&problem, least, most);
    ca_copy(n, problem.lower, lower);
    ca_copy(n, problem.upper, upper);
}

/* Prepare the vehicle, whose axes are independent; returns an enum ca_fault. */
SHARED int prepare_vehicle(void)
{
    if (m == 0 || set_up(&current, 0))
        return powerless(CA_NO_VOLUME);
    set_up(&once, 1);
    find_facets();
    ca_copy(m, hover, options.reference);
    options.on_reference = options.policy != CA_PRIORITIZED;
    if (options.on_reference) {
        find_margin(hover);
        if (!(margin > 1e-12))
            ca_copy(m, current.center, options.reference);
    }
    const int fault = ca_set_up(&problem, n, m, gamma, lower, upper, &options);
    if (fault || !(elapsed > 0))
        return fault ? powerless(fault) : 0;
    narrow_to_reach();
    if (set_up(&current, 0))
        return powerless(CA_NO_VOLUME);
    find_facets();
    return set_up(&once, 1);
}

static void pseudo_inverse(const ca_problem *p, const ca_real *u)
{
    for (int i = 0; i < n; i++) {
        thrusts[i] = 0;
        for (int j = 0; j < p->m; j++)
            thrusts[i] += p->basis[i][j] * ca_dot(j + 1, p->coordinates[j], u);
    }
}

/* Allocate the demand with a method; sets all results but the polygons and the explanation. */
static void answer(int method)
{
    const ca_real allowed = 1e-9 * ca_max(1, ca_length(m, demand));
    ca_real missed[CA_M];
    find_margin(demand);
    level = 1;
    status = CA_REJECTED;
    if (m == 0)
        ca_copy(n, lower, thrusts);
    else if (method == EXACT) {
        const ca_answer found = ca_allocate(&problem, demand, thrusts);
        status = found.status;
        level = found.level;
    } else if (method == ALL_AXES && all_axes.m)
        pseudo_inverse(&all_axes, asked);
    else
        pseudo_inverse(method == COMPUTED_ONCE ? &once : &current, demand);
    for (int i = 0; i < n; i++) {
        thrusts[i] = ca_clip(thrusts[i], lower[i], upper[i]);
        const ca_real below = 1e-12 * ca_max(1, ca_abs(lower[i]));
        const ca_real above = 1e-12 * ca_max(1, ca_abs(upper[i]));
        saturation[i] = thrusts[i] <= lower[i] + below ? -1 : thrusts[i] >= upper[i] - above;
    }
    for (int k = 0; k < m; k++)
        missed[k] = demand[k] - ca_dot(n, &gamma[k * n], thrusts);
    if (m && method != EXACT)
        status = ca_length(m, missed) <= allowed ? CA_EXACT : CA_INEXACT;
    speeds_of(thrusts, speeds);
}

/* Allocate the demand with a method; sets all results but the polygons. */
SHARED void allocate(int method)
{
    answer(method);
    if (m && method == EXACT)
        ca_explain(&problem, demand, thrusts, &why);
}

/* The kernel for the page: one vehicle, its attainable set, and other methods beside `exact`.
 *
 * The page writes the variables marked IN, calls a function, and reads those marked OUT. Rows are
 * axes in the order of the vehicle, columns rotors. After a failure, axes that the rotors cannot
 * control independently are left out, as `ca_ros.problem.audit` does.
 */
#include "exact.c" /* for span and normal_of */

#define SHARED __attribute__((visibility("default")))
#define IN SHARED
#define OUT SHARED
#define FACETS 8192
#define POINTS 65536
#define CORNERS 128 /* of one polygon */
#define INDEPENDENCE_MIN 0.05
#define SEGMENTS 64
#define THRUST 2 /* in the order force_x, force_y, thrust, roll, pitch, yaw */

enum method { EXACT, CLIPPED, COMPUTED_ONCE };

IN int rotors, axes, axis[CA_M]; /* `axis` has the place in the order above */
IN ca_real gamma[CA_M][CA_N];
IN ca_real lower[CA_N], upper[CA_N], weight[CA_N], preferred[CA_N];
IN ca_real forward[CA_N], reverse[CA_N], speed_min[CA_N], speed_max[CA_N];
IN ca_real reference[CA_M], slack;
/* A measured thrust curve: start [rad/s], a, b and c of each segment, which begins at a level [N], for
 * rotors with a k_f of `unit`. No segments: thrusts of k_f w^2. */
IN int segments;
IN ca_real segment[SEGMENTS][4], levels[SEGMENTS], unit;
IN int impaired[CA_N]; /* whether the health of a rotor is below 1 */
IN ca_real airmode[4]; /* as ca_options */
IN ca_real acceleration[CA_N], deceleration[CA_N], elapsed; /* time since hover [s]; 0: any time */
IN int policy, order[CA_M], group[CA_M], deviation; /* deviation: 0 prevent, 1 avoid, 2 allow */
IN ca_real demand[CA_M], base[CA_M];

OUT int kept[CA_M];                            /* whether the axis is controlled */
OUT ca_real center[CA_M], extent[CA_M];        /* of the attainable set [N, N m] */
OUT int facets;                                /* pairs of parallel facets; -1: too many */
OUT ca_real thrusts[CA_N], speeds[CA_N], wrench[CA_M], level, margin;
OUT ca_real served[CA_M];                      /* as ca_explanation */
OUT int blocked[CA_M][CA_N], airmode_blocks[CA_M], cause[CA_N];
OUT int status, saturation[CA_N], limit[CA_N]; /* `limit`: rotors at the nearest facet */
OUT ca_real points[POINTS][3];                 /* corners of polygons, in units of `extent` */
OUT int corners[FACETS * 2];

static ca_problem problem, current, once;
static int rows, row_of[CA_M]; /* axes that are controlled */
static ca_real normal[FACETS][CA_M], width[FACETS];

static void speeds_of(const ca_real *f, ca_real *w)
{
    if (!segments) {
        ca_speeds(rotors, f, forward, reverse, speed_min, speed_max, w);
        return;
    }
    for (int i = 0; i < rotors; i++) {
        const ca_real thrust = unit * (ca_max(f[i], 0) / forward[i]);
        int s = segments - 1;
        while (s > 0 && thrust < levels[s])
            s--;
        const ca_real a = segment[s][1], b = segment[s][2], rest = thrust - segment[s][3];
        const ca_real r = ca_sqrt(ca_max(b * b + 4 * a * rest, 0));
        const ca_real top = b >= 0 ? 2 * rest : r - b, bottom = b >= 0 ? b + r : 2 * a;
        w[i] = ca_clip(bottom > 0 || bottom < 0 ? top / bottom : 0, speed_min[i], speed_max[i]);
    }
}

static void thrusts_of(const ca_real *w, ca_real *f)
{
    if (!segments) {
        ca_thrusts(rotors, w, forward, reverse, f);
        return;
    }
    for (int i = 0; i < rotors; i++)
        f[i] = forward[i] / unit * ca_curve(segments, segment, ca_max(w[i], 0));
}

/* Whether the axes that are kept, without one more, are independent: the column of an axis in the
 * pseudo-inverse has the inverse of the distance of its row from the span of the others as length. */
static int independent(int without)
{
    static ca_problem part;
    part.n = rotors;
    part.m = 0;
    for (int i = 0; i < rotors; i++)
        part.half_range[i] = (upper[i] - lower[i]) / 2;
    for (int k = 0; k < axes; k++)
        if (kept[k] && k != without)
            ca_copy(rotors, gamma[k], part.gamma[part.m++]);
    if (!span(&part, 1))
        return 0;
    for (int k = 0; k < part.m; k++) {
        ca_real row = 0, column = 0;
        for (int i = 0; i < rotors; i++)
            row += part.gamma[k][i] * part.half_range[i] * part.gamma[k][i] * part.half_range[i];
        for (int j = k; j < part.m; j++)
            column += part.coordinates[j][k] * part.coordinates[j][k];
        if (!(row * column <= 1 / (INDEPENDENCE_MIN * INDEPENDENCE_MIN)))
            return 0;
    }
    return 1;
}

/* Give axes up until the others are independent; an axis whose loss suffices is preferred. */
static void audit(void)
{
    static const int expendable[] = {1, 0, 5, 4, 3};
    for (int k = 0; k < axes; k++)
        kept[k] = 1;
    while (!independent(-1)) {
        int first = -1, enough = -1;
        for (int e = 0; e < 5; e++)
            for (int k = 0; k < axes; k++)
                if (kept[k] && axis[k] == expendable[e]) {
                    first = first < 0 ? k : first;
                    enough = enough < 0 && independent(k) ? k : enough;
                }
        if (first < 0)
            return;
        kept[enough < 0 ? first : enough] = 0;
    }
}

static void find_facets(void)
{
    const int n = current.n, m = current.m, size = m - 1;
    int choice[CA_M];
    facets = 0;
    for (int r = 0; r < size; r++)
        choice[r] = r;
    for (;;) {
        ca_real *found = normal[facets];
        if (normal_of(&current, choice, found)) {
            int known = 0;
            for (int f = 0; f < facets && !known; f++) {
                ca_real same = 0, other = 0;
                for (int k = 0; k < m; k++) {
                    same = ca_max(same, ca_abs(found[k] - normal[f][k]));
                    other = ca_max(other, ca_abs(found[k] + normal[f][k]));
                }
                known = ca_min(same, other) < 1e-9;
            }
            width[facets] = 0;
            for (int i = 0; i < n; i++) {
                ca_real side = 0;
                for (int k = 0; k < m; k++)
                    side += found[k] * current.gamma[k][i];
                width[facets] += ca_abs(side) * current.half_range[i];
            }
            facets += !known;
        }
        int r = size - 1;
        while (r >= 0 && choice[r] == n - size + r)
            r--;
        if (r < 0)
            return;
        if (facets == FACETS) {
            facets = -1;
            return;
        }
        choice[r]++;
        for (int i = r + 1; i < size; i++)
            choice[i] = choice[i - 1] + 1;
    }
}

/* The distance of a wrench from the nearest facet, and the rotors at their bounds there. */
static void find_margin(const ca_real *u)
{
    int nearest = 0;
    ca_real side = 1;
    margin = CA_INFINITY;
    for (int f = 0; f < facets; f++) {
        ca_real height = 0;
        for (int k = 0; k < rows; k++)
            height += normal[f][k] * (u[k] - current.center[k]);
        if (width[f] - ca_abs(height) < margin) {
            margin = width[f] - ca_abs(height);
            nearest = f;
            side = height < 0 ? -1 : 1;
        }
    }
    for (int i = 0; i < rotors; i++) {
        ca_real sum = 0, size = 0;
        for (int k = 0; k < rows; k++) {
            sum += side * normal[nearest][k] * current.gamma[k][i];
            size += ca_abs(normal[nearest][k] * current.gamma[k][i]);
        }
        limit[i] = facets <= 0 || current.half_range[i] <= 0 || ca_abs(sum) <= 1e-10 * size ? 0
                   : sum > 0                                                               ? 1
                                                                                           : -1;
    }
}

static int set_up(ca_problem *made, const ca_real *least, const ca_real *most, int columns,
                  const ca_options *options)
{
    ca_real matrix[CA_M * CA_N];
    for (int k = 0; k < rows; k++)
        for (int i = 0; i < rotors; i++)
            matrix[k * rotors + i] = columns || most[i] > least[i] ? gamma[row_of[k]][i] : 0;
    return ca_set_up(made, rotors, rows, matrix, least, most, options);
}

/* Narrow the bounds to what the rotors reach from hover in the time that has elapsed. */
static void narrow_to_reach(const ca_options *options)
{
    ca_real least[CA_N], most[CA_N], now[CA_N];
    ca_allocate(&problem, options->reference, now);
    speeds_of(now, now);
    ca_reach(rotors, now, elapsed, acceleration, deceleration, speed_min, speed_max, least, most);
    thrusts_of(least, least);
    thrusts_of(most, most);
    for (int i = 0; i < rotors; i++) {
        /* A lost rotor has a coefficient of 1. */
        least[i] = ca_clip(least[i], lower[i], upper[i]);
        most[i] = ca_clip(most[i], lower[i], upper[i]);
    }
    ca_set_bounds(&problem, least, most);
    ca_copy(rotors, least, lower);
    ca_copy(rotors, most, upper);
}

/* Set the middle and half of the range of each axis, also of those that are lost. */
static void find_ranges(void)
{
    for (int k = 0; k < axes; k++) {
        center[k] = extent[k] = 0;
        for (int i = 0; i < rotors; i++) {
            center[k] += gamma[k][i] * (upper[i] + lower[i]) / 2;
            extent[k] += ca_abs(gamma[k][i]) * (upper[i] - lower[i]) / 2;
        }
        if (!(extent[k] > 0))
            extent[k] = 1;
    }
}

/* No axis can be controlled: the rotors are as slow as possible. */
static int powerless(int fault)
{
    rows = facets = 0;
    for (int k = 0; k < axes; k++)
        kept[k] = 0;
    return fault;
}

/* Prepare the vehicle; returns an enum ca_fault. */
SHARED int prepare_vehicle(void)
{
    ca_options options = {.policy = CA_REJECTED, .slack = slack, .thrust = -1, .airmode_limited = 1,
                          .airmode = {1, 1, 1, 1}, .reports_health = 1};
    find_ranges();
    audit();
    rows = 0;
    for (int k = 0; k < axes; k++)
        if (kept[k])
            row_of[rows++] = k;
    for (int k = 0; k < rows; k++) {
        options.order[k] = k;
        options.reference[k] = reference[row_of[k]];
    }
    if (rows == 0 || set_up(&current, lower, upper, 0, &options))
        return powerless(CA_NO_VOLUME);
    set_up(&once, lower, upper, 1, &options);
    find_facets();
    for (int k = 0; k < rows; k++) {
        center[row_of[k]] = current.center[k];
        extent[row_of[k]] = current.extent[k];
        if (axis[row_of[k]] == THRUST)
            options.thrust = k;
    }
    options.policy = policy;
    ca_copy(4, airmode, options.airmode);
    for (int i = 0; i < rotors; i++) {
        options.impaired[i] = impaired[i];
        options.weight[i] = weight[i];
        options.preferred[i] = preferred[i];
        if (weight[i] < 1 || weight[i] > 1 || preferred[i] < 0 || preferred[i] > 0)
            options.weighted = 1;
    }
    if (policy == CA_PRIORITIZED) {
        int count = 0, last = -1, number = -1;
        for (int k = 0; k < axes; k++) {
            if (!kept[order[k]])
                continue;
            number += group[k] != last;
            last = group[k];
            int row = 0;
            while (row_of[row] != order[k])
                row++;
            options.order[count] = row;
            options.group[count++] = number;
            options.keep_sense[row] =
                number > 0 && (deviation == 1 || (deviation == 0 && axis[order[k]] != THRUST));
        }
    } else {
        options.on_reference = 1;
        find_margin(options.reference);
        if (!(margin > 1e-12))
            for (int k = 0; k < rows; k++)
                options.reference[k] = current.center[k];
    }
    const int fault = set_up(&problem, lower, upper, 1, &options);
    if (fault || !(elapsed > 0))
        return fault ? powerless(fault) : 0;
    for (int k = 0; k < rows; k++)
        options.reference[k] = reference[row_of[k]];
    narrow_to_reach(&options);
    if (set_up(&current, lower, upper, 0, &options))
        return powerless(CA_NO_VOLUME);
    find_facets();
    return set_up(&once, lower, upper, 1, &options);
}

static void pseudo_inverse(const ca_problem *p, const ca_real *u, ca_real *f)
{
    for (int i = 0; i < rotors; i++) {
        f[i] = 0;
        for (int j = 0; j < rows; j++)
            f[i] += p->basis[i][j] * ca_dot(j + 1, p->coordinates[j], u);
    }
}

static void explain(const ca_real *u)
{
    static ca_explanation found;
    ca_explain(&problem, u, thrusts, &found);
    for (int k = 0; k < rows; k++) {
        served[row_of[k]] = found.served[k];
        airmode_blocks[row_of[k]] = ca_abs(found.airmode[k]) > 0;
        for (int i = 0; i < rotors; i++)
            blocked[row_of[k]][i] = found.gain[k][i] > 0;
    }
    for (int i = 0; i < rotors; i++)
        cause[i] = found.limit[i];
}

/* Allocate the demand with a method; sets all results but the polygons. */
SHARED void allocate(int method)
{
    ca_real u[CA_M];
    for (int k = 0; k < rows; k++)
        u[k] = demand[row_of[k]];
    find_margin(u);
    level = 1;
    status = CA_REJECTED;
    if (rows == 0)
        ca_copy(rotors, lower, thrusts);
    else if (method == EXACT) {
        const ca_answer answer = ca_allocate(&problem, u, thrusts);
        status = answer.status;
        level = answer.level;
        explain(u);
    } else
        pseudo_inverse(method == CLIPPED ? &current : &once, u, thrusts);
    for (int i = 0; i < rotors; i++) {
        thrusts[i] = ca_clip(thrusts[i], lower[i], upper[i]);
        const ca_real below = 1e-12 * ca_max(1, ca_abs(lower[i]));
        const ca_real above = 1e-12 * ca_max(1, ca_abs(upper[i]));
        saturation[i] = thrusts[i] <= lower[i] + below ? -1 : thrusts[i] >= upper[i] - above;
    }
    ca_real missed = 0;
    for (int k = 0; k < axes; k++) {
        wrench[k] = ca_dot(rotors, gamma[k], thrusts);
        missed += kept[k] ? (demand[k] - wrench[k]) * (demand[k] - wrench[k]) : 0;
    }
    if (rows && method != EXACT)
        status = ca_sqrt(missed) <= 1e-9 * ca_max(1, ca_length(rows, u)) ? CA_EXACT : CA_INEXACT;
    speeds_of(thrusts, speeds);
}

/* Cut a polygon by a plane: keep what satisfies g x <= h. Returns the number of corners. */
static int cut(int count, ca_real polygon[CORNERS][3], const ca_real *g)
{
    static ca_real kept_part[CORNERS][3];
    int left = 0;
    for (int i = 0; i < count && left < CORNERS - 1; i++) {
        const ca_real *from = polygon[i], *to = polygon[(i + 1) % count];
        const ca_real a = ca_dot(3, g, from) - g[3], b = ca_dot(3, g, to) - g[3];
        if (a <= 0)
            ca_copy(3, from, kept_part[left++]);
        if ((a < 0 && b > 0) || (a > 0 && b < 0)) {
            for (int k = 0; k < 3; k++)
                kept_part[left][k] = from[k] + a / (a - b) * (to[k] - from[k]);
            left++;
        }
    }
    for (int i = 0; i < left; i++)
        ca_copy(3, kept_part[i], polygon[i]);
    return left;
}

/* The attainable wrenches whose other axes are those of `base`: polygons over rows a, b and c, or
 * one polygon over a and b if c is -1. Returns their number; -1 if there are too many facets. */
SHARED int section(int a, int b, int c)
{
    static ca_real planes[2 * FACETS][4], polygon[CORNERS][3];
    const int shown[3] = {a, b, c};
    int count = 0, polygons = 0, used = 0;
    if (facets <= 0)
        return facets;
    for (int f = 0; f < 2 * facets; f++) {
        const ca_real side = f % 2 ? -1 : 1, *facet = normal[f / 2];
        ca_real *plane = planes[count], most = width[f / 2];
        plane[0] = plane[1] = plane[2] = 0;
        for (int k = 0; k < rows; k++) {
            int place = -1;
            for (int s = 0; s < 3; s++)
                place = shown[s] == row_of[k] ? s : place;
            const ca_real at = place >= 0 ? center[row_of[k]] : base[row_of[k]];
            if (place >= 0)
                plane[place] = side * facet[k] * extent[row_of[k]];
            most -= side * facet[k] * (at - current.center[k]);
        }
        const ca_real length = ca_length(3, plane);
        if (length <= 1e-12 * width[f / 2]) {
            if (most < -1e-9 * width[f / 2])
                return 0;
            continue;
        }
        for (int k = 0; k < 3; k++)
            plane[k] /= length;
        plane[3] = most / length;
        int known = 0;
        for (int j = 0; j < count && !known; j++)
            known = ca_abs(plane[0] - planes[j][0]) + ca_abs(plane[1] - planes[j][1]) +
                        ca_abs(plane[2] - planes[j][2]) + ca_abs(plane[3] - planes[j][3]) < 1e-9;
        count += !known;
    }
    for (int f = 0; f < (c < 0 ? 1 : count); f++) {
        const ca_real flat[4] = {0, 0, 1, 0}, *plane = c < 0 ? flat : planes[f];
        ca_real side[3], up[3];
        int least = 0;
        for (int k = 1; k < 3; k++)
            least = ca_abs(plane[k]) < ca_abs(plane[least]) ? k : least;
        for (int k = 0; k < 3; k++)
            side[k] = (k == least) - plane[least] * plane[k];
        const ca_real length = ca_length(3, side);
        for (int k = 0; k < 3; k++)
            side[k] /= length;
        for (int k = 0; k < 3; k++)
            up[k] = plane[(k + 1) % 3] * side[(k + 2) % 3] - plane[(k + 2) % 3] * side[(k + 1) % 3];
        for (int i = 0; i < 4; i++)
            for (int k = 0; k < 3; k++)
                polygon[i][k] = plane[k] * plane[3] + 4 * ((i == 0 || i == 3 ? 1 : -1) * side[k] +
                                                           (i < 2 ? 1 : -1) * up[k]);
        int size = 4;
        for (int j = 0; j < count && size > 0; j++)
            if (c < 0 || j != f)
                size = cut(size, polygon, planes[j]);
        if (size < 3)
            continue;
        if (used + size > POINTS)
            return -1;
        for (int i = 0; i < size; i++)
            ca_copy(3, polygon[i], points[used + i]);
        used += size;
        corners[polygons++] = size;
    }
    return polygons;
}

/* Priorities: which wrench to serve if the demand is not attainable.
 *
 * Groups of axes are served one after the other, each as far as the groups before it allow. Each
 * step is a linear program over the thrusts, solved by the simplex method for bounded variables.
 * The variables are thrusts x between -1 and 1 and axes y = A x, scaled. The state is a dictionary:
 * m basic variables as linear functions of the nonbasic ones. All variables always satisfy their
 * bounds. A push moves one variable towards its goal, as far as the bounds of the others allow.
 */
#include "priorities.h"
#include "numbers.h"

#include <string.h>

/* Rate below which a variable does not depend on another; rates are of the order of 1. */
#define ZERO CA_CHOOSE(1e-8, 1e-5)
/* Rate below which it is a rounding error. */
#define NOISE CA_CHOOSE(1e-13, 1e-5)
/* Distance by which rounding may move a variable out of its bounds. */
#define SLACK CA_CHOOSE(1e-12, 1e-6)
/* Rate below which a variable does not block a move. */
#define STILL CA_CHOOSE(1e-9, 1e-5)
/* Bound of the pivots of one push, per variable. */
#define PIVOTS_PER_VARIABLE 8
/* Greatest share of the way to the boundary of the set where a line may begin. */
#define INSIDE CA_REAL(0.99)
/* Distance from the reference, as a share of an axis's range, that counts as none. */
#define REST CA_CHOOSE(1e-9, 1e-5)
/* Least weight of an axis in its group, as a share of its range. */
#define LAG CA_REAL(1e-3)
/* Least weight of an axis in its group, relative to the greatest. */
#define LAG_RATIO CA_REAL(1e-6)
/* A demand counts as served within DOUBT times the error estimate of the simplex method. */
#define DOUBT CA_CHOOSE(10, 1)

/* Rate below which two facets are almost parallel. */
#define PARALLEL CA_REAL(1e-3)

/* The first group adds two variables at most. Each later group of several axes adds one, and two more
 * for each of its axes. */
#define ROWS (3 * CA_M)
#define COLUMNS (CA_N + CA_M + 1)
#define VARIABLES (CA_N + CA_M + 2 + 3 * CA_M)

/* Variables are numbered: first the thrusts, then the axes, then those that are added. The basic
 * variable of row r is at place r, the nonbasic one of column k at place ROWS + k. Columns from
 * `columns` on hold nonbasic variables that cannot move any more; their rates are not kept. */
typedef struct {
    int rows, columns, all_columns, count;
    int variable[ROWS + COLUMNS], place[VARIABLES];
    ca_real value[ROWS + COLUMNS], lower[ROWS + COLUMNS], upper[ROWS + COLUMNS];
    ca_real rates[ROWS][COLUMNS];
    /* Bound of the distance that pushes may have missed because of rounding. */
    ca_real doubt;
    int pivots;
    /* Whether a thrust is at its bound in all solutions, and the least rate that proves it. */
    int held[CA_N];
    ca_real least_rate;
    int thrusts;
    /* Whether a variable that is pushed may not move away later. */
    int final;
} simplex;

static ca_real value_of(const simplex *s, int v)
{
    return s->value[s->place[v]];
}

static void put(simplex *s, int place, int v, ca_real value, ca_real lower, ca_real upper)
{
    s->variable[place] = v;
    s->place[v] = place;
    s->value[place] = value;
    s->lower[place] = lower;
    s->upper[place] = upper;
}

static void swap(simplex *s, int a, int b)
{
    const int v = s->variable[a];
    const ca_real value = s->value[a], lower = s->lower[a], upper = s->upper[a];
    put(s, a, s->variable[b], s->value[b], s->lower[b], s->upper[b]);
    put(s, b, v, value, lower, upper);
}

/* Exchange the basic variable of row r and nonbasic variable k. */
static void exchange(simplex *s, int r, int k)
{
    ca_real *row = s->rates[r];
    const ca_real inverse = 1 / row[k];
    const int columns = s->columns;
    s->doubt = ca_max(s->doubt, SLACK * ca_abs(inverse));
    for (int j = 0; j < columns; j++)
        row[j] *= -inverse;
    row[k] = inverse;
    for (int i = 0; i < s->rows; i++) {
        ca_real *other = s->rates[i];
        const ca_real factor = other[k];
        if (i == r || ca_equal(factor, 0))
            continue;
        other[k] = 0;
        for (int j = 0; j < columns; j++)
            other[j] += factor * row[j];
    }
    swap(s, r, ROWS + k);
    s->pivots++;
}

/* Stop to keep the rates of nonbasic variable k, which cannot move any more. */
static void drop(simplex *s, int k)
{
    const int last = --s->columns;
    if (k == last)
        return;
    swap(s, ROWS + k, ROWS + last);
    for (int r = 0; r < s->rows; r++)
        s->rates[r][k] = s->rates[r][last];
}

/* Add a nonbasic variable; returns its column, whose rates are not set. */
static int add_column(simplex *s, ca_real value, ca_real upper)
{
    const int k = s->columns++, end = ROWS + s->all_columns++;
    if (ROWS + k < end)
        put(s, end, s->variable[ROWS + k], s->value[ROWS + k], s->lower[ROWS + k],
            s->upper[ROWS + k]);
    put(s, ROWS + k, s->count++, value, 0, upper);
    return k;
}

/* Move nonbasic variable k by `way`, at most to the first bound that blocks it. Returns whether the
 * move was completed; `blocked` is the row of the variable that blocks, or -1. The variable of row
 * `target` does not block. If there is a target, the bounds of k itself do. */
static int move(simplex *s, int k, ca_real way, int target, int *blocked)
{
    const int x = ROWS + k;
    const ca_real sign = way > 0 ? CA_REAL(1) : CA_REAL(-1);
    ca_real length = ca_abs(way), room[ROWS], speed[ROWS];
    int row[ROWS], near = 0, reached = 1;
    *blocked = -1;
    if (target >= 0) {
        const ca_real own = way > 0 ? s->upper[x] - s->value[x] : s->value[x] - s->lower[x];
        if (own < length) {
            length = own;
            reached = 0;
        }
    }
    /* Harris's ratio test: bounds may be exceeded by rounding errors, so that of the variables that
     * block almost together the fastest one, the best pivot, leaves the basis. */
    ca_real furthest = length;
    for (int r = 0; r < s->rows; r++) {
        const ca_real rate = sign * s->rates[r][k], size = ca_abs(rate);
        if (r == target || size < STILL)
            continue;
        const ca_real left = rate > 0 ? s->upper[r] - s->value[r] : s->value[r] - s->lower[r];
        if (left < size * furthest) {
            row[near] = r;
            room[near] = ca_max(left, 0);
            speed[near] = size;
            furthest = ca_min(furthest, (room[near++] + SLACK) / size);
        }
    }
    if (furthest < length) {
        ca_real fastest = 0;
        int first = 0;
        for (int i = 0; i < near; i++)
            if (speed[i] > fastest && room[i] <= speed[i] * furthest) {
                fastest = speed[i];
                first = i;
            }
        *blocked = row[first];
        length = ca_min(room[first] / speed[first], length);
        reached = 0;
    }
    const ca_real step = sign * length;
    s->value[x] += step;
    for (int r = 0; r < s->rows; r++)
        s->value[r] += step * s->rates[r][k];
    if (*blocked >= 0)
        s->value[*blocked] =
            sign * s->rates[*blocked][k] > 0 ? s->upper[*blocked] : s->lower[*blocked];
    else if (!reached)
        s->value[x] = way > 0 ? s->upper[x] : s->lower[x];
    return reached;
}

/* Whether the variable at a place can move towards a goal at `rate`. */
static int can_move(const simplex *s, int place, int up)
{
    return up ? s->value[place] < s->upper[place] : s->value[place] > s->lower[place];
}

/* The variable of row r cannot move any further: note what proves it. */
static void prove(simplex *s, int r, ca_real left)
{
    for (int j = 0; j < s->columns; j++) {
        const ca_real rate = s->rates[r][j], size = ca_abs(rate);
        const int x = s->variable[ROWS + j];
        const ca_real value = s->value[ROWS + j], lower = s->lower[ROWS + j],
                      upper = s->upper[ROWS + j];
        if (s->final && size > NOISE && x < s->thrusts && lower < upper)
            s->least_rate = ca_min(s->least_rate, size);
        if (size > ZERO) {
            if (s->final && x < s->thrusts)
                s->held[x] = 1;
        } else if (size > 0) {
            s->doubt += size * ca_min(rate * left > 0 ? upper - value : value - lower, 2);
        }
    }
}

/* Move variable v towards a goal, as far as the bounds of the others allow. Returns whether v has
 * reached the goal. */
static int approach(simplex *s, int v, ca_real goal)
{
    int blocked, place = s->place[v];
    if (ca_equal(s->value[place], goal))
        return 1;
    if (place >= ROWS + s->columns || (place >= ROWS && !(s->lower[place] < s->upper[place])))
        return 0;
    if (place >= ROWS) {
        if (move(s, place - ROWS, goal - s->value[place], -1, &blocked)) {
            s->value[place] = goal;
            return 1;
        }
        exchange(s, blocked, place - ROWS);
    }
    const int r = s->place[v];
    for (int pivot = 0; pivot < PIVOTS_PER_VARIABLE * s->count; pivot++) {
        const ca_real left = goal - s->value[r];
        ca_real best = ZERO;
        int k = -1;
        for (int j = 0; j < s->columns; j++) {
            const ca_real rate = s->rates[r][j], size = ca_abs(rate);
            if (size > best && can_move(s, ROWS + j, (rate > 0) == (left > 0))) {
                best = size;
                k = j;
                /* Later take the first that moves v, not the fastest, to prevent cycles. */
                if (pivot > s->count)
                    break;
            }
        }
        if (k < 0) {
            prove(s, r, left);
            return 0;
        }
        if (move(s, k, left / s->rates[r][k], r, &blocked)) {
            s->value[r] = goal;
            return 1;
        }
        if (blocked >= 0) {
            exchange(s, blocked, k);
            if (!(s->lower[ROWS + k] < s->upper[ROWS + k]))
                drop(s, k);
        }
    }
    return 0;
}

/* Later moves never move v away from its goal again. */
static void hold(simplex *s, int v, ca_real goal)
{
    const int place = s->place[v];
    s->lower[place] = ca_min(s->value[place], goal);
    s->upper[place] = ca_max(s->value[place], goal);
    if (place >= ROWS && place < ROWS + s->columns && ca_equal(s->value[place], goal))
        drop(s, place - ROWS);
}

static void push(simplex *s, int v, ca_real goal)
{
    approach(s, v, goal);
    hold(s, v, goal);
}

/* Fix variable v at its value, and make it nonbasic. */
static void release(simplex *s, int v)
{
    const int r = s->place[v];
    ca_real greatest = -1;
    int pivot = 0;
    s->lower[r] = s->upper[r] = s->value[r];
    if (r >= ROWS)
        return;
    for (int j = 0; j < s->columns; j++) {
        const int x = ROWS + j;
        /* A thrust whose bounds have met is the last choice. */
        const ca_real weight = s->lower[x] < s->upper[x]       ? CA_REAL(1)
                               : s->variable[x] < s->thrusts ? CA_REAL(1e-6)
                                                             : 0;
        const ca_real size = weight * ca_abs(s->rates[r][j]);
        if (size > greatest) {
            greatest = size;
            pivot = j;
        }
    }
    exchange(s, r, pivot);
}

/* Add a variable, the distance that nonbasic variables move together along a line. */
static int add_ray(simplex *s, int count, const int *variables, const ca_real *direction)
{
    const int k = add_column(s, 0, CA_UNBOUNDED), ray = s->variable[ROWS + k];
    for (int r = 0; r < s->rows; r++) {
        ca_real rate = 0;
        for (int i = 0; i < count; i++)
            rate += direction[i] * s->rates[r][s->place[variables[i]] - ROWS];
        s->rates[r][k] = rate;
    }
    return ray;
}

/* From now on nonbasic variables move along rays only. */
static void drop_all(simplex *s, int count, const int *variables)
{
    for (int i = 0; i < count; i++)
        drop(s, s->place[variables[i]] - ROWS);
}

/* Add a variable, the greatest weighted distance of some axes to their goals. */
static int add_lag(simplex *s, int count, const int *axes, const ca_real *goals,
                   const ca_real *weights)
{
    ca_real most = 0;
    for (int i = 0; i < count; i++)
        most = ca_max(most, ca_abs(goals[i] - value_of(s, s->thrusts + axes[i])) / weights[i]);
    const int column = add_column(s, most, most), lag = s->variable[ROWS + column];
    for (int r = 0; r < s->rows; r++)
        s->rates[r][column] = 0;
    for (int i = 0; i < count; i++) {
        const int place = s->place[s->thrusts + axes[i]];
        for (int side = 0; side < 2; side++) {
            const ca_real weight = side ? -weights[i] : weights[i];
            const int row = s->rows++;
            for (int k = 0; k < column; k++)
                s->rates[row][k] = place < ROWS ? s->rates[place][k] : (ca_real)(place == ROWS + k);
            s->rates[row][column] = weight;
            /* The variable plus its share of the lag is at the goal or beyond, on either side. */
            put(s, row, s->count++, s->value[place] + weight * most,
                side ? -CA_UNBOUNDED : goals[i], side ? goals[i] : CA_UNBOUNDED);
        }
    }
    return lag;
}

static void clear(const ca_problem *p, simplex *s)
{
    const int n = CA_ROTORS(p), m = CA_AXES(p);
    s->rows = m;
    s->columns = s->all_columns = s->thrusts = n;
    s->count = n + m;
    s->pivots = 0;
    s->least_rate = 1;
    s->final = 0;
    for (int i = 0; i < n; i++)
        s->held[i] = 0;
}

/* Whether `ca_set_bounds` has narrowed the bounds. */
static int is_narrowed(const ca_problem *p)
{
    for (int i = 0; i < CA_ROTORS(p); i++)
        if (p->lower[i] > p->least[i] || p->upper[i] < p->most[i])
            return 1;
    return 0;
}

/* Begin at the middle of the bounds, with all thrusts nonbasic. */
static void begin_in_middle(const ca_problem *p, int moved, simplex *s)
{
    const int n = CA_ROTORS(p), m = CA_AXES(p);
    clear(p, s);
    s->doubt = SLACK;
    for (int i = 0; i < n; i++) {
        const ca_real middle = p->middle[i], half = p->half_range[i];
        const int narrowed = moved && half > 0;
        const ca_real low = narrowed ? (p->lower[i] - middle) / half : -1;
        const ca_real high = narrowed ? (p->upper[i] - middle) / half : 1;
        put(s, ROWS + i, i, moved ? (low + high) / 2 : 0, low, high);
    }
    for (int k = 0; k < m; k++) {
        for (int i = 0; i < n; i++)
            s->rates[k][i] = p->gamma[k][i] * p->half_range[i] / p->extent[k];
        put(s, k, n + k, moved ? ca_dot(n, s->rates[k], s->value + ROWS) : 0, -CA_UNBOUNDED,
            CA_UNBOUNDED);
    }
}

/* Restore the dictionary at the beginning of the line. */
static void begin(const ca_problem *p, simplex *s)
{
    const int n = CA_ROTORS(p), m = CA_AXES(p);
    clear(p, s);
    s->doubt = p->doubt;
    for (int k = 0; k < m; k++) {
        put(s, k, p->basic[k], p->row_value[k], p->row_lower[k], p->row_upper[k]);
        for (int i = 0; i < n; i++)
            s->rates[k][i] = p->rates[k][i];
    }
    for (int i = 0; i < n; i++)
        put(s, ROWS + i, p->nonbasic[i], p->column_value[i], p->column_lower[i],
            p->column_upper[i]);
}

static void keep(const simplex *s, ca_problem *p)
{
    const int n = CA_ROTORS(p), m = CA_AXES(p);
    p->doubt = s->doubt;
    for (int k = 0; k < m; k++) {
        p->basic[k] = s->variable[k];
        p->row_value[k] = s->value[k];
        p->row_lower[k] = s->lower[k];
        p->row_upper[k] = s->upper[k];
        for (int i = 0; i < n; i++)
            p->rates[k][i] = s->rates[k][i];
    }
    for (int i = 0; i < n; i++) {
        p->nonbasic[i] = s->variable[ROWS + i];
        p->column_value[i] = s->value[ROWS + i];
        p->column_lower[i] = s->lower[ROWS + i];
        p->column_upper[i] = s->upper[ROWS + i];
    }
}

/* Number of axes in the group that begins at `first` in the order. */
static int group_size(const ca_problem *p, int first)
{
    int size = 1;
    while (first + size < CA_AXES(p) && p->group[first + size] == p->group[first])
        size++;
    return size;
}

/* Confine a variable between two values, or between the nearest that is possible and them. */
static void confine(simplex *s, int v, ca_real low, ca_real high)
{
    const ca_real value = value_of(s, v), nearest = ca_clip(value, low, high);
    approach(s, v, nearest);
    const int place = s->place[v];
    s->lower[place] = ca_min(s->value[place], low);
    s->upper[place] = ca_max(s->value[place], high);
}

/* Move some axes along a line; returns the share of it that is possible, 1 without a line. */
static ca_real push_along(simplex *s, int ray, ca_real size)
{
    push(s, ray, size);
    return ca_clip(value_of(s, ray) / size, 0, 1);
}

static ca_real direction_of(int count, const ca_real *ways, ca_real *direction)
{
    ca_real size = 0;
    for (int i = 0; i < count; i++)
        size = ca_max(size, ca_abs(ways[i]));
    if (!(size > 0))
        size = 1;
    for (int i = 0; i < count; i++)
        direction[i] = ways[i] / size;
    return size;
}

/* Serve a demand, given as scaled goals, by the scaled wrench `axes`. Returns the share of the line
 * that the first group moved along, or -1 if the bounds keep it away from the line. */
static ca_real serve(const ca_problem *p, const ca_real *goals, const ca_real *reference,
                     int senses, simplex *s, ca_real *axes)
{
    const int n = CA_ROTORS(p), m = CA_AXES(p), first = group_size(p, 0);
    const int thrust = senses ? p->thrust : -1, moved = is_narrowed(p) && !p->widened;
    const ca_real demand = thrust < 0 ? 0 : ca_clip(goals[thrust], -1, 1);
    int variables[CA_M] = {0};
    ca_real ways[CA_M] = {0}, rest[CA_M] = {0}, share = 1, left = 0;
    if (moved || p->widened)
        begin_in_middle(p, 1, s);
    else
        begin(p, s);
    for (int i = 0; i < m; i++)
        variables[i] = n + p->order[i];
    for (int i = 0; (moved || p->widened) && first > 1 && i < first; i++) {
        if (p->widened)
            approach(s, variables[i], p->begin[i]);
        release(s, variables[i]);
    }
    if (thrust >= 0)
        confine(s, n + thrust, -CA_UNBOUNDED, demand + p->rise);
    s->final = 1;
    if (first == 1) {
        push(s, variables[0], goals[p->order[0]]);
    } else {
        ca_real direction[CA_M], back[CA_M];
        int homeward = -1;
        for (int i = 0; i < first; i++) {
            const int axis = p->order[i];
            ways[i] = goals[axis] - p->begin[i];
            rest[i] = moved ? p->begin[i] - value_of(s, variables[i]) : 0;
        }
        const ca_real size = direction_of(first, ways, direction);
        const ca_real distance = direction_of(first, rest, back);
        if (moved)
            homeward = add_ray(s, first, variables, back);
        const int length = add_ray(s, first, variables, direction);
        drop_all(s, first, variables);
        if (moved) {
            /* The bounds may keep the first group away from the line: go there first. */
            s->upper[s->place[length]] = size;
            left = 1 - push_along(s, homeward, distance);
        }
        share = push_along(s, length, size);
    }
    if (thrust >= 0 && p->later_rise < CA_UNBOUNDED) {
        /* Thrust rises for the others above its demand, or above what the first group needs. */
        s->final = 0;
        approach(s, n + thrust, demand);
        confine(s, n + thrust, -CA_UNBOUNDED, demand + p->later_rise);
    } else if (thrust >= 0) {
        s->lower[s->place[n + thrust]] = -CA_UNBOUNDED;
        s->upper[s->place[n + thrust]] = CA_UNBOUNDED;
    }
    s->final = 1;
    for (int i = first; senses && i < m; i++) {
        const int axis = p->order[i], v = variables[i];
        if (!p->keep_sense[axis])
            continue;
        const ca_real value = value_of(s, v), low = ca_min(goals[axis], reference[axis]),
                      high = ca_max(goals[axis], reference[axis]),
                      nearest = ca_clip(value, low, high);
        if (approach(s, v, nearest)) {
            const int place = s->place[v];
            s->lower[place] = ca_max(s->lower[place], low);
            s->upper[place] = ca_min(s->upper[place], high);
        } else {
            hold(s, v, nearest);
        }
    }
    for (int i = first; i < m;) {
        const int count = group_size(p, i);
        if (count > 1) {
            ca_real ends[CA_M], weights[CA_M], longest = LAG;
            for (int k = 0; k < count; k++) {
                const int axis = p->order[i + k];
                ends[k] = goals[axis];
                weights[k] = ca_abs(goals[axis] - reference[axis]);
                longest = ca_max(longest, weights[k]);
            }
            for (int k = 0; k < count; k++)
                weights[k] = ca_max(ca_max(weights[k], LAG) / longest, LAG_RATIO);
            push(s, add_lag(s, count, p->order + i, ends, weights), 0);
        }
        for (int k = 0; k < count; k++) {
            const int axis = p->order[i + k];
            push(s, variables[i + k], goals[axis]);
        }
        i += count;
    }
    for (int k = 0; k < m; k++)
        axes[k] = value_of(s, n + k);
    for (int i = 0; first > 1 && i < first; i++) {
        const int axis = p->order[i];
        axes[axis] = share >= 1 ? goals[axis] : p->begin[i] + share * ways[i];
        if (left > 0)
            axes[axis] -= left * rest[i];
    }
    return left > 0 ? -1 : share;
}

static void scale(const ca_problem *p, const ca_real *u, ca_real *goals)
{
    for (int k = 0; k < CA_AXES(p); k++)
        goals[k] = (u[k] - p->center[k]) / p->extent[k];
}

void ca_priorities_set_up(ca_problem *p, int on_reference)
{
    const int n = CA_ROTORS(p), m = CA_AXES(p), first = group_size(p, 0);
    simplex s;
    ca_real reference[CA_M] = {0}, axes[CA_M];

    p->on_reference = 0;
    scale(p, p->reference, reference);
    begin_in_middle(p, 0, &s);
    if (first > 1) {
        /* The line begins at the reference, or before it if the reference is not well inside. */
        ca_real ways[CA_M] = {0}, direction[CA_M], part = 1;
        int variables[CA_M] = {0};
        if (!on_reference) {
            for (int i = 0; i < first; i++) {
                variables[i] = n + p->order[i];
                ways[i] = reference[p->order[i]];
                release(&s, variables[i]);
            }
            const ca_real size = direction_of(first, ways, direction);
            const int length = add_ray(&s, first, variables, direction);
            drop_all(&s, first, variables);
            push(&s, length, size / INSIDE);
            part = ca_min(1, INSIDE * value_of(&s, length) / size);
        }
        p->on_reference = 1;
        begin_in_middle(p, 0, &s);
        for (int i = 0; i < first; i++) {
            p->begin[i] = part * reference[p->order[i]];
            p->on_reference = p->on_reference && ca_equal(p->begin[i], reference[p->order[i]]);
            approach(&s, n + p->order[i], p->begin[i]);
            release(&s, n + p->order[i]);
        }
    }
    keep(&s, p);
    serve(p, reference, reference, 0, &s, axes);
    for (int k = 0; k < m; k++)
        if (ca_abs(axes[k] - reference[k]) > REST)
            p->keep_sense[k] = 0;
}

/* A thrust that is neither held nor basic can be chosen. If there is one such thrust, choose it so
 * that the thrusts have the least norm. Returns the number of such thrusts; 2 also for more, or if
 * their number is not clear. */
static int choose(const ca_problem *p, const simplex *s, ca_real *thrusts)
{
    const int n = CA_ROTORS(p);
    ca_real rates[CA_N], slope = 0, curvature = 0, low = -CA_UNBOUNDED, high = CA_UNBOUNDED;
    int k = -1, clear = 1;
    for (int j = 0; j < s->columns; j++) {
        const int x = s->variable[ROWS + j];
        if (x >= n || s->held[x] || !(p->lower[x] < p->upper[x]))
            continue;
        if (k >= 0)
            return 2;
        k = j;
    }
    if (k < 0)
        return 0;
    for (int i = 0; i < n; i++)
        rates[i] = 0;
    const int chosen = s->variable[ROWS + k];
    rates[chosen] = p->half_range[chosen];
    for (int r = 0; r < s->rows; r++) {
        const int v = s->variable[r];
        if (v < n)
            rates[v] = p->half_range[v] * s->rates[r][k];
        else if (ca_abs(s->rates[r][k]) > PARALLEL)
            /* The thrust would move an axis that has reached its goal. */
            return 0;
        else
            clear = clear && ca_abs(s->rates[r][k]) <= NOISE;
    }
    /* Small pivots magnify rounding errors: whether this one would move an axis is not clear. */
    if (!clear)
        return 2;
    for (int i = 0; i < n; i++) {
        const ca_real square = p->weight[i] * p->weight[i];
        slope += square * rates[i] * (thrusts[i] - p->preferred[i]);
        curvature += square * rates[i] * rates[i];
        if (ca_abs(rates[i]) > STILL * p->half_range[i]) {
            const ca_real down = (p->lower[i] - thrusts[i]) / rates[i];
            const ca_real up = (p->upper[i] - thrusts[i]) / rates[i];
            low = ca_max(low, ca_min(down, up));
            high = ca_min(high, ca_max(down, up));
        }
    }
    const ca_real step = ca_min(ca_max(-slope / curvature, low), high);
    for (int i = 0; i < n; i++)
        thrusts[i] = ca_clip(thrusts[i] + step * rates[i], p->lower[i], p->upper[i]);
    return 1;
}

void ca_prioritize(const ca_problem *p, const ca_real *u, ca_served *served, int *pivots,
                   int *steps)
{
    const int n = CA_ROTORS(p), m = CA_AXES(p), first = group_size(p, 0);
    simplex s;
    ca_real goals[CA_M] = {0}, reference[CA_M] = {0}, axes[CA_M], wrench[CA_M], missed[CA_M];
    ca_real *thrusts = served->face.thrusts;

    scale(p, u, goals);
    scale(p, p->reference, reference);
    const ca_real share = serve(p, goals, reference, 1, &s, axes);
    *pivots += s.pivots;
    for (int i = 0; i < n; i++)
        thrusts[i] = ca_clip(p->middle[i] + p->half_range[i] * value_of(&s, i), p->lower[i],
                             p->upper[i]);
    for (int i = 0; i < n; i++)
        served->face.held[i] = s.held[i];
    served->almost_parallel = s.least_rate < PARALLEL;
    const int choices = choose(p, &s, thrusts);
    served->unique = choices == 0;
    served->least = choices < 2;
    for (int k = 0; k < m; k++)
        wrench[k] = p->center[k] + p->extent[k] * axes[k];
    /* The small pivots of almost symmetric vehicles lose digits. */
    ca_leave(p, wrench, thrusts, missed);
    const ca_real tolerance = CA_TOLERANCE * ca_max(1, ca_length(m, wrench));
    if (!ca_within(p, ca_length(m, missed), tolerance, CA_REAL(0.5), thrusts)) {
        ca_settle(p, wrench, tolerance, thrusts, steps);
        ca_leave(p, wrench, thrusts, missed);
    }
    served->reached = 1;
    served->level = 1;
    for (int k = 0; k < m; k++)
        served->face.wrench[k] = wrench[k] - missed[k];
    const ca_real rounding = ca_rounding(p, thrusts);
    for (int i = 0; i < m; i++) {
        const int axis = p->order[i];
        const ca_real way = u[axis] - p->reference[axis];
        ca_real level = 0;
        const ca_real doubt = DOUBT * s.doubt * p->extent[axis];
        if (ca_abs(served->face.wrench[axis] - u[axis]) <= ca_max(doubt, rounding))
            continue;
        served->reached = 0;
        if (i < first && first > 1 && p->on_reference && share >= 0)
            level = share;
        else if (ca_abs(way) > 0)
            level = ca_clip((served->face.wrench[axis] - p->reference[axis]) / way, 0, 1);
        served->level = ca_min(served->level, level);
    }
}

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

/* The type of the numbers here. In single precision this file is compiled twice: in single
 * precision, and by priorities_wide.c in double precision, for the set-up and for wrenches for
 * which rounding errors of single precision could decide. There Gamma has its rest, see
 * `ca_options`. Without it, rates that are zero in an unrounded problem are up to about 1e-7. */
#ifdef CA_WIDE
typedef double real;
#define WIDE 1
#define SETS_UP 1
#define SERVE ca_serve_wide
#define real_abs fabs
#define CHOOSE(in_double, in_float, rounded) (s->refined ? (real)(in_double) : (real)(rounded))
#else
typedef ca_real real;
#define WIDE 0
#define SETS_UP CA_CHOOSE_INT(1, 0)
#define SERVE ca_serve
#define real_abs ca_abs
#define CHOOSE(in_double, in_float, rounded) CA_CHOOSE(in_double, in_float)
#endif
#define REAL(x) ((real)(x))
#ifdef CA_FLOAT
#define GAMMA(p, k, i) ((real)(p)->gamma[k][i] + (real)(p)->rest[k][i])
#define IS_REFINED(p) ((p)->refined)
#define IS_NEARLY_LEVEL(p) (!WIDE && (p)->nearly_level)
#else
#define GAMMA(p, k, i) (p)->gamma[k][i]
#define IS_REFINED(p) ((void)(p), 0)
#define IS_NEARLY_LEVEL(p) ((void)(p), 0)
#endif
#define UNBOUNDED REAL(CA_UNBOUNDED)

/* Rate below which a variable does not depend on another; rates are of the order of 1. */
#define ZERO CHOOSE(1e-8, 1e-6, 1e-6)
/* Share of `doubt` below which a rate may be what pivots have made of rounding errors. SLACK is 4500
 * epsilons in double precision, but 8 in single precision. */
#define MAGNIFIED CHOOSE(1e-3, 0.5, 1e-3)
/* Rate below which it is a rounding error. */
#define NOISE CHOOSE(1e-13, 1e-6, 1e-6)
/* Rate below which it could be a rounding error that pivots have magnified: if one decides, another
 * run in double precision is to answer. */
#define UNCLEAR CHOOSE(0, 3e-3, 0)
/* Distance by which rounding may move a variable out of its bounds. */
#define SLACK CHOOSE(1e-12, 1e-6, 1e-7)
/* Rate below which a variable does not block a move. */
#define RATE_MIN CHOOSE(1e-9, 1e-6, 1e-6)
/* Weight of the rate of a variable less than NEAR from its bound, if one is to enter the basis without
 * a move. */
#define AT_BOUND REAL(0.1)
#define NEAR REAL(1e-3)
/* Greatest share of the way to a bound where a line begins, if it need not be nearer to it. */
#define SPREAD REAL(0.9)
/* Bound of the pivots of one push, per variable. */
#define PIVOTS_PER_VARIABLE 3
/* Greatest share of the way to the boundary of the set where a line may begin. */
#define INSIDE REAL(0.99)
/* Distance from the reference, as a share of an axis's range, that counts as none. */
#define REST REAL(CA_CHOOSE(1e-9, 1e-6))
#define LAG REAL(CA_LAG)
#define LAG_RATIO REAL(CA_LAG_RATIO)
/* A demand counts as served within ERROR_FACTOR times the error estimate of the simplex method. */
#define ERROR_FACTOR REAL(CA_CHOOSE(10, 1))

/* Rate below which two facets are almost parallel. */
#define PARALLEL REAL(1e-3)

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
    real value[ROWS + COLUMNS], lower[ROWS + COLUMNS], upper[ROWS + COLUMNS];
    real rates[ROWS][COLUMNS];
    /* Bound of the distance that pushes may have missed because of rounding. */
    real doubt;
    int pivots;
    /* Whether Gamma has its rest, and whether a small rate may not be a rounding error. */
    int refined, nearly_level;
    /* Whether a rate below UNCLEAR has decided; the pushes after it do nothing. */
    int unclear;
    /* Whether a thrust is at its bound in all solutions, and the least rate that proves it. */
    int held[CA_N];
    real least_rate;
    int thrusts;
    /* Whether a variable that is pushed may not move away later. */
    int final;
    /* Whether a push that takes more pivots than there are rows and columns is unclear: another
     * method is to answer. */
    int brief;
} simplex;

static inline real real_min(real a, real b) { return a < b ? a : b; }
static inline real real_max(real a, real b) { return a > b ? a : b; }

static inline real real_clip(real x, real lower, real upper)
{
    return real_min(real_max(x, lower), upper);
}

/* See `ca_equal`. */
static inline int real_equal(real a, real b) { return a <= b && a >= b; }

static real value_of(const simplex *s, int v)
{
    return s->value[s->place[v]];
}

/* A threshold of rates, above the rounding errors that pivots have magnified. */
static real above_noise(const simplex *s, real rate)
{
    return real_max(rate, MAGNIFIED * s->doubt);
}

static void put(simplex *s, int place, int v, real value, real lower, real upper)
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
    const real value = s->value[a], lower = s->lower[a], upper = s->upper[a];
    put(s, a, s->variable[b], s->value[b], s->lower[b], s->upper[b]);
    put(s, b, v, value, lower, upper);
}

/* Exchange the basic variable of row r and nonbasic variable k. */
static void exchange(simplex *s, int r, int k)
{
    real *row = s->rates[r];
    const real inverse = 1 / row[k];
    const int columns = s->columns;
    s->doubt = real_max(s->doubt, SLACK * real_abs(inverse));
    for (int j = 0; j < columns; j++)
        row[j] *= -inverse;
    row[k] = inverse;
    for (int i = 0; i < s->rows; i++) {
        real *other = s->rates[i];
        const real factor = other[k];
        if (i == r || !(real_abs(factor) > 0))
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
static int add_column(simplex *s, real value, real upper)
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
static int move(simplex *s, int k, real way, int target, int *blocked)
{
    const int x = ROWS + k;
    const real sign = way > 0 ? REAL(1) : REAL(-1);
    const real least = above_noise(s, RATE_MIN);
    real length = real_abs(way), room[ROWS], speed[ROWS];
    int row[ROWS], near = 0, reached = 1;
    *blocked = -1;
    if (target >= 0) {
        const real own = way > 0 ? s->upper[x] - s->value[x] : s->value[x] - s->lower[x];
        if (own < length) {
            length = own;
            reached = 0;
        }
    }
    /* Harris's ratio test: bounds may be exceeded by rounding errors, so that of the variables that
     * block almost together the fastest one, the best pivot, leaves the basis. */
    real furthest = length;
    for (int r = 0; r < s->rows; r++) {
        const real rate = sign * s->rates[r][k], size = real_abs(rate);
        if (r == target || size < least)
            continue;
        const real left = rate > 0 ? s->upper[r] - s->value[r] : s->value[r] - s->lower[r];
        if (left < size * furthest) {
            row[near] = r;
            room[near] = real_max(left, 0);
            speed[near] = size;
            furthest = real_min(furthest, (room[near++] + SLACK) / size);
        }
    }
    if (near > 0 && furthest < length) {
        real fastest = 0;
        int first = 0;
        for (int i = 0; i < near; i++)
            if (speed[i] > fastest && room[i] <= speed[i] * furthest) {
                fastest = speed[i];
                first = i;
            }
        *blocked = row[first];
        s->unclear = s->unclear || fastest < UNCLEAR;
        length = real_min(room[first] / speed[first], length);
        reached = 0;
    }
    const real step = sign * length;
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
static void prove(simplex *s, int r, real left)
{
    const real zero = above_noise(s, ZERO);
    for (int j = 0; j < s->columns; j++) {
        const real rate = s->rates[r][j], size = real_abs(rate);
        const int x = s->variable[ROWS + j];
        const real value = s->value[ROWS + j], lower = s->lower[ROWS + j],
                      upper = s->upper[ROWS + j];
        if (s->final && size > NOISE && x < s->thrusts && lower < upper)
            s->least_rate = real_min(s->least_rate, size);
        /* Neither its sign nor whether it is zero may be clear. */
        if (s->nearly_level && size > 0 && size < UNCLEAR && lower < upper)
            s->unclear = 1;
        if (size > zero) {
            if (s->final && x < s->thrusts)
                s->held[x] = 1;
        } else if (size > 0) {
            s->doubt += size * real_min(rate * left > 0 ? upper - value : value - lower, 2);
        }
    }
}

/* Move variable v towards a goal, as far as the bounds of the others allow. Returns whether v has
 * reached the goal. */
static int approach(simplex *s, int v, real goal)
{
    int blocked, place = s->place[v];
    if (real_equal(s->value[place], goal))
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
    const int limit = s->brief ? s->rows + s->columns : PIVOTS_PER_VARIABLE * s->count;
    for (int pivot = 0; pivot < limit && !s->unclear; pivot++) {
        const real left = goal - s->value[r];
        real best = above_noise(s, ZERO);
        int k = -1;
        for (int j = 0; j < s->columns; j++) {
            const real rate = s->rates[r][j], size = real_abs(rate);
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
        s->unclear = s->unclear || best < UNCLEAR;
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
    s->unclear = s->unclear || s->brief;
    return 0;
}

/* Later moves never move v away from its goal again. */
static void hold(simplex *s, int v, real goal)
{
    const int place = s->place[v];
    s->lower[place] = real_min(s->value[place], goal);
    s->upper[place] = real_max(s->value[place], goal);
    if (place >= ROWS && place < ROWS + s->columns && real_equal(s->value[place], goal))
        drop(s, place - ROWS);
}

static void push(simplex *s, int v, real goal)
{
    approach(s, v, goal);
    hold(s, v, goal);
}

/* Move basic variable v towards a goal by all nonbasic variables, each in proportion to its rate, so
 * that few thrusts end at their bounds: at most SPREAD of the way to the first bound. */
static void spread(simplex *s, int v, real goal)
{
    const int target = s->place[v];
    real square = 0, share = 1, changes[ROWS + COLUMNS];
    for (int j = 0; j < s->columns; j++)
        if (s->lower[ROWS + j] < s->upper[ROWS + j])
            square += s->rates[target][j] * s->rates[target][j];
    if (!(square > 0))
        return;
    const real factor = (goal - s->value[target]) / square;
    for (int r = 0; r < s->rows; r++)
        changes[r] = 0;
    for (int j = 0; j < s->columns; j++) {
        const int moves = s->lower[ROWS + j] < s->upper[ROWS + j];
        changes[ROWS + j] = moves ? factor * s->rates[target][j] : 0;
        for (int r = 0; r < s->rows; r++)
            changes[r] += changes[ROWS + j] * s->rates[r][j];
    }
    for (int i = 0; i < ROWS + s->columns; i++) {
        if (i >= s->rows && i < ROWS)
            continue;
        const real room = changes[i] > 0 ? s->upper[i] - s->value[i] : s->lower[i] - s->value[i];
        if (share * real_abs(changes[i]) > SPREAD * real_abs(room))
            share = SPREAD * room / changes[i];
    }
    for (int i = 0; i < ROWS + s->columns; i++)
        if (i < s->rows || i >= ROWS)
            s->value[i] += share * changes[i];
    if (share >= 1)
        s->value[target] = goal;
}

/* Fix variable v at its value, and make it nonbasic. */
static void release(simplex *s, int v)
{
    const int r = s->place[v];
    real greatest = -1;
    int pivot = 0;
    s->lower[r] = s->upper[r] = s->value[r];
    if (r >= ROWS)
        return;
    for (int j = 0; j < s->columns; j++) {
        const int x = ROWS + j;
        /* A thrust near its bound would soon block, however small its rate. One whose bounds have met
         * is the last choice. */
        const int inside = s->lower[x] + NEAR < s->value[x] && s->value[x] < s->upper[x] - NEAR;
        const real weight = inside                           ? REAL(1)
                            : s->lower[x] < s->upper[x]      ? AT_BOUND
                            : s->variable[x] < s->thrusts    ? REAL(1e-6)
                                                             : 0;
        const real size = weight * real_abs(s->rates[r][j]);
        if (size > greatest) {
            greatest = size;
            pivot = j;
        }
    }
    s->unclear = s->unclear || greatest < UNCLEAR;
    exchange(s, r, pivot);
}

/* Add a variable, the distance that nonbasic variables move together along a line. */
static int add_ray(simplex *s, int count, const int *variables, const real *direction)
{
    const int k = add_column(s, 0, UNBOUNDED), ray = s->variable[ROWS + k];
    for (int r = 0; r < s->rows; r++) {
        real rate = 0;
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
static int add_lag(simplex *s, int count, const int *axes, const real *goals,
                   const real *weights)
{
    real most = 0;
    for (int i = 0; i < count; i++)
        most = real_max(most, real_abs(goals[i] - value_of(s, s->thrusts + axes[i])) / weights[i]);
    const int column = add_column(s, most, most), lag = s->variable[ROWS + column];
    for (int r = 0; r < s->rows; r++)
        s->rates[r][column] = 0;
    for (int i = 0; i < count; i++) {
        const int place = s->place[s->thrusts + axes[i]];
        for (int side = 0; side < 2; side++) {
            const real weight = side ? -weights[i] : weights[i];
            const int row = s->rows++;
            for (int k = 0; k < column; k++)
                s->rates[row][k] = place < ROWS ? s->rates[place][k] : (real)(place == ROWS + k);
            s->rates[row][column] = weight;
            /* The variable plus its share of the lag is at the goal or beyond, on either side. */
            put(s, row, s->count++, s->value[place] + weight * most,
                side ? -UNBOUNDED : goals[i], side ? goals[i] : UNBOUNDED);
        }
    }
    return lag;
}

/* Scale a basic variable so that its rates are of the order of 1, as those of the others: the lag of
 * small weights has greater ones, and as much greater rounding errors. */
static void normalize(simplex *s, int v)
{
    const int r = s->place[v];
    real greatest = 1;
    for (int j = 0; r < ROWS && j < s->columns; j++)
        greatest = real_max(greatest, real_abs(s->rates[r][j]));
    for (int j = 0; r < ROWS && j < s->columns; j++)
        s->rates[r][j] /= greatest;
    s->value[r] /= greatest;
    s->lower[r] /= greatest;
    s->upper[r] /= greatest;
}

static void clear(const ca_problem *p, simplex *s)
{
    const int n = CA_ROTORS(p), m = CA_AXES(p);
    s->rows = m;
    s->columns = s->all_columns = s->thrusts = n;
    s->count = n + m;
    s->pivots = 0;
    s->unclear = 0;
    s->refined = IS_REFINED(p);
    s->nearly_level = IS_NEARLY_LEVEL(p);
    s->least_rate = 1;
    s->final = s->brief = 0;
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

/* The wrench of the middle of the bounds, and half of the range of an axis. Those of the problem are
 * rounded to single precision: axes that do not move along a line would seem to. */
static real center_of(const ca_problem *p, int k)
{
#if WIDE
    real sum = 0;
    for (int i = 0; i < CA_ROTORS(p); i++)
        sum += GAMMA(p, k, i) * (real)p->middle[i];
    return sum;
#else
    return p->center[k];
#endif
}

static real extent_of(const ca_problem *p, int k)
{
#if WIDE
    real sum = 0;
    for (int i = 0; i < CA_ROTORS(p); i++)
        sum += real_abs(GAMMA(p, k, i) * (real)p->half_range[i]);
    return sum;
#else
    return p->extent[k];
#endif
}

/* Begin at the middle of the bounds, with all thrusts nonbasic. */
static void begin_in_middle(const ca_problem *p, int moved, simplex *s)
{
    const int n = CA_ROTORS(p), m = CA_AXES(p);
    clear(p, s);
    s->doubt = SLACK;
    for (int i = 0; i < n; i++) {
        const real middle = (real)p->middle[i], half = (real)p->half_range[i];
        const int narrowed = moved && half > 0;
        const real low = narrowed ? ((real)p->lower[i] - middle) / half : -1;
        const real high = narrowed ? ((real)p->upper[i] - middle) / half : 1;
        put(s, ROWS + i, i, moved ? (low + high) / 2 : 0, low, high);
    }
    for (int k = 0; k < m; k++) {
        const real extent = extent_of(p, k);
        real value = 0;
        for (int i = 0; i < n; i++) {
            const real half = (real)p->half_range[i];
            s->rates[k][i] = GAMMA(p, k, i) * half / extent;
            value += s->rates[k][i] * s->value[ROWS + i];
        }
        put(s, k, n + k, moved ? value : 0, -UNBOUNDED, UNBOUNDED);
    }
}

/* Restore the dictionary at the beginning of the line. */
static void begin(const ca_problem *p, simplex *s)
{
    const int n = CA_ROTORS(p), m = CA_AXES(p);
    clear(p, s);
    s->doubt = real_max((real)p->doubt, SLACK);
    for (int k = 0; k < m; k++) {
        put(s, k, p->basic[k], (real)p->row_value[k], (real)p->row_lower[k],
            (real)p->row_upper[k]);
        for (int i = 0; i < n; i++)
            s->rates[k][i] = (real)p->rates[k][i];
    }
    for (int i = 0; i < n; i++)
        put(s, ROWS + i, p->nonbasic[i], (real)p->column_value[i], (real)p->column_lower[i],
            (real)p->column_upper[i]);
}

#if SETS_UP
static void keep(const simplex *s, ca_problem *p)
{
    const int n = CA_ROTORS(p), m = CA_AXES(p);
    p->doubt = (ca_real)s->doubt;
    for (int k = 0; k < m; k++) {
        p->basic[k] = s->variable[k];
        p->row_value[k] = (ca_real)s->value[k];
        p->row_lower[k] = (ca_real)s->lower[k];
        p->row_upper[k] = (ca_real)s->upper[k];
        for (int i = 0; i < n; i++)
            p->rates[k][i] = (ca_real)s->rates[k][i];
    }
    for (int i = 0; i < n; i++) {
        p->nonbasic[i] = s->variable[ROWS + i];
        p->column_value[i] = (ca_real)s->value[ROWS + i];
        p->column_lower[i] = (ca_real)s->lower[ROWS + i];
        p->column_upper[i] = (ca_real)s->upper[ROWS + i];
    }
}
#endif

/* Number of axes in the group that begins at `first` in the order. */
static int group_size(const ca_problem *p, int first)
{
    int size = 1;
    while (first + size < CA_AXES(p) && p->group[first + size] == p->group[first])
        size++;
    return size;
}

/* Confine a variable between two values, or between the nearest that is possible and them. */
static void confine(simplex *s, int v, real low, real high)
{
    const real value = value_of(s, v), nearest = real_clip(value, low, high);
    approach(s, v, nearest);
    const int place = s->place[v];
    s->lower[place] = real_min(s->value[place], low);
    s->upper[place] = real_max(s->value[place], high);
}

/* Move some axes along a line; returns the share of it that is possible, 1 without a line. */
static real push_along(simplex *s, int ray, real size)
{
    push(s, ray, size);
    return real_clip(value_of(s, ray) / size, 0, 1);
}

static real direction_of(int count, const real *ways, real *direction)
{
    real size = 0;
    for (int i = 0; i < count; i++)
        size = real_max(size, real_abs(ways[i]));
    if (!(size > 0))
        size = 1;
    for (int i = 0; i < count; i++)
        direction[i] = ways[i] / size;
    return size;
}

/* Where the line of the first group begins: a part of the way from the middle to the reference.
 * In double precision an axis is not to move by rounding along the line to a demand that has it
 * at the reference. */
static void find_begin(const ca_problem *p, const real *reference, real *begin)
{
    const int first = group_size(p, 0);
    real part = 1, longest = 0;
    for (int i = 0; i < first; i++) {
        begin[i] = (real)p->begin[i];
        if (WIDE && !p->on_reference && real_abs(begin[i]) > longest) {
            longest = real_abs(begin[i]);
            part = begin[i] / reference[p->order[i]];
        }
    }
    for (int i = 0; WIDE && i < first; i++)
        begin[i] = part * reference[p->order[i]];
}

/* Go where the line of the first group begins, or only towards it if the bounds have moved. */
static void go_to_line(const ca_problem *p, int moved, const real *begin, simplex *s)
{
    const int first = group_size(p, 0);
    begin_in_middle(p, moved || p->widened, s);
    for (int i = 0; first > 1 && i < first; i++) {
        const int axis = p->order[i], v = CA_ROTORS(p) + axis;
        if (!moved) {
            spread(s, v, begin[i]);
            approach(s, v, begin[i]);
        }
        release(s, v);
    }
}

/* Where the first group of axes is on its line, after a share of the way. */
static void place_first(const ca_problem *p, const real *goals, const real *begin_at, real share,
                        real *axes)
{
    const int first = group_size(p, 0);
    for (int i = 0; first > 1 && i < first; i++) {
        const int axis = p->order[i];
        axes[axis] = share >= 1 ? goals[axis] : begin_at[i] + share * (goals[axis] - begin_at[i]);
    }
}

/* The weights with which the axes of a group lag behind their goals together. */
static void weigh_lags(int count, const real *distances, real *weights)
{
    real longest = LAG;
    for (int k = 0; k < count; k++)
        longest = real_max(longest, distances[k]);
    for (int k = 0; k < count; k++)
        weights[k] = real_max(real_max(distances[k], LAG) / longest, LAG_RATIO);
}

/* Serve the groups after the first one after the other, and set the scaled wrench `axes`. If
 * `senses`, the axes stay on the side of the reference on which their demand is. */
static void serve_later(const ca_problem *p, const real *goals, const real *reference, int senses,
                        simplex *s, real *axes)
{
    const int n = CA_ROTORS(p), m = CA_AXES(p), first = group_size(p, 0);
    for (int i = first; senses && i < m; i++) {
        const int axis = p->order[i], v = n + axis;
        if (!p->keep_sense[axis])
            continue;
        const real value = value_of(s, v), low = real_min(goals[axis], reference[axis]),
                      high = real_max(goals[axis], reference[axis]),
                      nearest = real_clip(value, low, high);
        if (approach(s, v, nearest)) {
            const int place = s->place[v];
            s->lower[place] = real_max(s->lower[place], low);
            s->upper[place] = real_min(s->upper[place], high);
        } else {
            hold(s, v, nearest);
        }
    }
    for (int i = first; i < m;) {
        const int count = group_size(p, i);
        if (count > 1) {
            real ends[CA_M], distances[CA_M], weights[CA_M];
            for (int k = 0; k < count; k++) {
                const int axis = p->order[i + k];
                ends[k] = goals[axis];
                distances[k] = real_abs(goals[axis] - reference[axis]);
            }
            weigh_lags(count, distances, weights);
            const int lag = add_lag(s, count, p->order + i, ends, weights);
            push(s, lag, 0);
            normalize(s, lag);
        }
        for (int k = 0; k < count; k++) {
            const int axis = p->order[i + k];
            push(s, n + axis, goals[axis]);
        }
        i += count;
    }
    for (int k = 0; k < m; k++)
        axes[k] = value_of(s, n + k);
}

/* Serve a demand, given as scaled goals, by the scaled wrench `axes`. Returns the share of the line
 * that the first group moved along, or -1 if the bounds keep it away from the line. */
static real serve(const ca_problem *p, const real *goals, const real *reference, int senses,
                  simplex *s, real *axes)
{
    const int n = CA_ROTORS(p), first = group_size(p, 0);
    const int thrust = senses ? p->thrust : -1, moved = is_narrowed(p) && !p->widened;
    const real demand = thrust < 0 ? 0 : real_clip(goals[thrust], -1, 1);
    int variables[CA_M] = {0};
    real begin_at[CA_M] = {0}, ways[CA_M] = {0}, rest[CA_M] = {0}, share = 1, left = 0;
    find_begin(p, reference, begin_at);
    /* The dictionary that is kept is in the precision of the problem. */
    if (moved || p->widened || WIDE)
        go_to_line(p, moved, begin_at, s);
    else
        begin(p, s);
    for (int i = 0; i < first; i++)
        variables[i] = n + p->order[i];
    if (thrust >= 0)
        confine(s, n + thrust, -UNBOUNDED, demand + (real)p->rise);
    s->final = 1;
    if (first == 1) {
        push(s, variables[0], goals[p->order[0]]);
    } else {
        real direction[CA_M], back[CA_M];
        int homeward = -1;
        for (int i = 0; i < first; i++) {
            const int axis = p->order[i];
            ways[i] = goals[axis] - begin_at[i];
            rest[i] = moved ? begin_at[i] - value_of(s, variables[i]) : 0;
        }
        const real size = direction_of(first, ways, direction);
        const real distance = direction_of(first, rest, back);
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
        confine(s, n + thrust, -UNBOUNDED, demand + (real)p->later_rise);
    } else if (thrust >= 0) {
        s->lower[s->place[n + thrust]] = -UNBOUNDED;
        s->upper[s->place[n + thrust]] = UNBOUNDED;
    }
    s->final = 1;
    serve_later(p, goals, reference, senses, s, axes);
    place_first(p, goals, begin_at, share, axes);
    for (int i = 0; left > 0 && i < first; i++)
        axes[p->order[i]] -= left * rest[i];
    return left > 0 ? -1 : share;
}

static void scale(const ca_problem *p, const ca_real *u, real *goals)
{
    for (int k = 0; k < CA_AXES(p); k++)
        goals[k] = ((real)u[k] - center_of(p, k)) / extent_of(p, k);
}

#if SETS_UP
void ca_priorities_set_up(ca_problem *p, int on_reference)
{
    const int n = CA_ROTORS(p), m = CA_AXES(p), first = group_size(p, 0);
    simplex s;
    real reference[CA_M] = {0}, axes[CA_M];

    p->on_reference = 0;
    scale(p, p->reference, reference);
    begin_in_middle(p, 0, &s);
    if (first > 1) {
        /* The line begins at the reference, or before it if the reference is not well inside. */
        real ways[CA_M] = {0}, direction[CA_M], part = 1;
        int variables[CA_M] = {0};
        if (!on_reference) {
            for (int i = 0; i < first; i++) {
                variables[i] = n + p->order[i];
                ways[i] = reference[p->order[i]];
                release(&s, variables[i]);
            }
            const real size = direction_of(first, ways, direction);
            const int length = add_ray(&s, first, variables, direction);
            drop_all(&s, first, variables);
            push(&s, length, size / INSIDE);
            part = real_min(1, INSIDE * value_of(&s, length) / size);
        }
        p->on_reference = 1;
        begin_in_middle(p, 0, &s);
        for (int i = 0; i < first; i++) {
            const real at = reference[p->order[i]];
            p->begin[i] = (ca_real)(part * at);
            p->on_reference = p->on_reference && ca_equal(p->begin[i], (ca_real)at);
            spread(&s, n + p->order[i], (real)p->begin[i]);
            approach(&s, n + p->order[i], (real)p->begin[i]);
            release(&s, n + p->order[i]);
        }
    }
    keep(&s, p);
    serve(p, reference, reference, 0, &s, axes);
    for (int k = 0; k < m; k++)
        if (real_abs(axes[k] - reference[k]) > REST)
            p->keep_sense[k] = 0;
}
#endif

/* A thrust that is neither held nor basic can be chosen. If there is one such thrust, choose it so
 * that the thrusts have the least norm. Returns the number of such thrusts; 2 also for more, or if
 * their number is not clear. */
static int choose(const ca_problem *p, const simplex *s, ca_real *thrusts)
{
    const int n = CA_ROTORS(p);
    real rates[CA_N], slope = 0, curvature = 0, low = -UNBOUNDED, high = UNBOUNDED;
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
    rates[chosen] = (real)p->half_range[chosen];
    for (int r = 0; r < s->rows; r++) {
        const int v = s->variable[r];
        if (v < n)
            rates[v] = (real)p->half_range[v] * s->rates[r][k];
        else if (real_abs(s->rates[r][k]) > PARALLEL)
            /* The thrust would move an axis that has reached its goal. */
            return 0;
        else
            clear = clear && real_abs(s->rates[r][k]) <= NOISE;
    }
    /* Small pivots magnify rounding errors: whether this one would move an axis is not clear. */
    if (!clear)
        return 2;
    for (int i = 0; i < n; i++) {
        const real weight = (real)p->weight[i], square = weight * weight, f = (real)thrusts[i];
        slope += square * rates[i] * (f - (real)p->preferred[i]);
        curvature += square * rates[i] * rates[i];
        if (real_abs(rates[i]) > RATE_MIN * (real)p->half_range[i]) {
            const real down = ((real)p->lower[i] - f) / rates[i];
            const real up = ((real)p->upper[i] - f) / rates[i];
            low = real_max(low, real_min(down, up));
            high = real_min(high, real_max(down, up));
        }
    }
    const real step = real_min(real_max(-slope / curvature, low), high);
    for (int i = 0; i < n; i++)
        thrusts[i] = ca_clip((ca_real)((real)thrusts[i] + step * rates[i]), p->lower[i],
                             p->upper[i]);
    return 1;
}

#if !WIDE
/* Within one plane mostly the last group alone gives way, and its axes keep their senses. Returns
 * whether it does. */
static int give_way(const ca_problem *p, const ca_real *u, const ca_plane *plane, ca_real *wrench)
{
    const int m = CA_AXES(p);
    int start = m - 1;
    real distances[CA_M] = {0}, shares[CA_M] = {1};
    ca_real gap = -plane->height, greatest = 0, reach = 0;
    while (start > 0 && p->group[start - 1] == p->group[m - 1])
        start--;
    for (int k = 0; k < m; k++) {
        gap += plane->normal[k] * (u[k] - p->center[k]);
        greatest = ca_max(greatest, ca_abs(plane->normal[k]) * p->extent[k]);
    }
    if (start == 0 || !(gap > 0))
        return 0;
    const int *axes = p->order + start, count = m - start;
    for (int i = 0; count > 1 && i < count; i++)
        distances[i] = real_abs(u[axes[i]] - p->reference[axes[i]]) / p->extent[axes[i]];
    if (count > 1)
        weigh_lags(count, distances, shares);
    for (int i = 0; i < count; i++) {
        const ca_real rate = ca_abs(plane->normal[axes[i]]), extent = p->extent[axes[i]];
        const int clear = ca_clarity(rate * extent, greatest);
        if (!clear)
            return 0;
        shares[i] = clear < 0 ? 0 : count > 1 ? shares[i] * extent : 1;
        reach += rate * shares[i];
    }
    if (!(reach > 0))
        return 0;
    ca_copy(m, u, wrench);
    for (int i = 0; i < count; i++) {
        const int k = axes[i];
        const ca_real part = (plane->normal[k] < 0 ? -gap : gap) / reach * shares[i];
        const ca_real way = u[k] - p->reference[k];
        wrench[k] -= part;
        if (p->keep_sense[k] && !(part > 0 ? way >= part : way <= part))
            return 0;
    }
    return 1;
}

/* Add the distance from a plane as a basic variable. Columns are those of `begin_within`, `at`
 * and `direction` are in the order of the priorities. Returns 0 if it is not clear whether the
 * plane goes along an axis, or if the wrench is beyond it. */
static int add_plane(const ca_problem *p, const ca_plane *plane, int along, const real *at,
                     const real *direction, simplex *s)
{
    const int m = CA_AXES(p), r = s->rows++;
    real slopes[CA_M], greatest = 0, ray = 0;
    for (int k = 0; k < m; k++) {
        slopes[k] = plane->normal[k] * p->extent[k];
        greatest = real_max(greatest, real_abs(slopes[k]));
    }
    const real unit = 1 / greatest;
    real room = unit * plane->height;
    for (int i = 0; i < m; i++) {
        const real slope = -unit * slopes[p->order[i]];
        const int clear = ca_clarity(real_abs(slope), 1);
        const real rate = clear > 0 ? slope : 0;
        if (!clear)
            return 0;
        room += rate * at[i];
        if (i < along)
            ray += rate * direction[i];
        else
            s->rates[r][i - along] = rate;
    }
    if (along)
        s->rates[r][m - along] = ray;
    put(s, r, r, room, 0, UNBOUNDED);
    return room > 0;
}

/* Begin where the line of the first group does. Nonbasic are the axes, but those that move
 * `along` this line only: for these, the distance along it. */
static void begin_within(const ca_problem *p, int along, const real *at, simplex *s)
{
    const int n = CA_ROTORS(p), m = CA_AXES(p);
    clear(p, s);
    s->doubt = SLACK;
    s->final = s->brief = 1;
    s->rows = 0;
    s->columns = m - along + (along > 0);
    s->all_columns = s->columns + along;
    for (int i = along; i < m; i++)
        put(s, ROWS + i - along, n + p->order[i], at[i], -UNBOUNDED, UNBOUNDED);
    for (int i = 0; i < along; i++)
        put(s, ROWS + s->columns + i, n + p->order[i], at[i], at[i], at[i]);
    if (along)
        put(s, ROWS + m - along, s->count++, 0, 0, UNBOUNDED);
}

int ca_serve_within(const ca_problem *p, const ca_real *u, int count, const ca_plane *planes,
                    ca_real *wrench, int *touched, ca_real *share, int *pivots)
{
    const int n = CA_ROTORS(p), m = CA_AXES(p), first = group_size(p, 0), along = first > 1 ? first : 0;
    simplex s;
    real goals[CA_M] = {0}, reference[CA_M] = {0}, at[CA_M] = {0}, ways[CA_M] = {0};
    real direction[CA_M] = {0}, axes[CA_M];
    *share = 1;
    touched[0] = 1;
    if (count > 1 || !give_way(p, u, planes, wrench)) {
        scale(p, u, goals);
        scale(p, p->reference, reference);
        find_begin(p, reference, at);
        for (int i = 0; i < along; i++)
            ways[i] = goals[p->order[i]] - at[i];
        for (int i = along; i < m; i++)
            at[i] = reference[p->order[i]];
        const real size = direction_of(along, ways, direction);
        begin_within(p, along, at, &s);
        for (int r = 0; r < count; r++)
            if (!add_plane(p, &planes[r], along, at, direction, &s))
                return 0;
        if (along)
            *share = push_along(&s, s.count - 1, size);
        else
            push(&s, n + p->order[0], goals[p->order[0]]);
        serve_later(p, goals, reference, 1, &s, axes);
        place_first(p, goals, at, *share, axes);
        *pivots += s.pivots;
        if (s.unclear)
            return 0;
        for (int k = 0; k < m; k++)
            wrench[k] = real_equal(axes[k], goals[k]) ? u[k] : p->center[k] + p->extent[k] * axes[k];
        for (int r = 0; r < count; r++)
            touched[r] = s.held[r];
    }
    /* A limit on airmode is for the bounds of the thrusts. */
    return p->thrust < 0 || wrench[p->thrust] <= u[p->thrust];
}

void ca_judge(const ca_problem *p, const ca_real *u, ca_real share, ca_real doubt, ca_served *served)
{
    const int m = CA_AXES(p), first = group_size(p, 0);
    const ca_real rounding = ca_min(p->rounding, ca_rounding(p, served->face.thrusts));
    served->reached = 1;
    served->level = 1;
    for (int i = 0; i < m; i++) {
        const int axis = p->order[i];
        const ca_real way = u[axis] - p->reference[axis];
        const ca_real missed = ca_abs(served->face.wrench[axis] - u[axis]);
        ca_real level = 0;
        if (missed <= doubt * p->extent[axis] || missed <= rounding)
            continue;
        served->reached = 0;
        if (i < first && first > 1 && p->on_reference && share >= 0)
            level = share;
        else if (ca_abs(way) > 0)
            level = ca_clip((served->face.wrench[axis] - p->reference[axis]) / way, 0, 1);
        served->level = ca_min(served->level, level);
    }
}
#endif

int SERVE(const ca_problem *p, const ca_real *u, ca_served *served, int *pivots, int *steps)
{
    const int n = CA_ROTORS(p), m = CA_AXES(p);
    simplex s;
    real goals[CA_M] = {0}, reference[CA_M] = {0}, axes[CA_M];
    ca_real wrench[CA_M], missed[CA_M], *thrusts = served->face.thrusts;

    scale(p, u, goals);
    scale(p, p->reference, reference);
    const real share = serve(p, goals, reference, 1, &s, axes);
    *pivots += s.pivots;
    if (s.unclear)
        return 0;
    for (int i = 0; i < n; i++) {
        const real f = (real)p->middle[i] + (real)p->half_range[i] * value_of(&s, i);
        thrusts[i] = ca_clip((ca_real)f, p->lower[i], p->upper[i]);
    }
    for (int i = 0; i < n; i++)
        served->face.held[i] = s.held[i];
    served->almost_parallel = s.least_rate < PARALLEL;
    const int choices = choose(p, &s, thrusts);
    served->unique = choices == 0;
    served->least = choices < 2;
    for (int k = 0; k < m; k++)
        wrench[k] = (ca_real)(center_of(p, k) + extent_of(p, k) * axes[k]);
    /* The small pivots of almost symmetric vehicles lose digits. */
    ca_leave(p, wrench, thrusts, missed);
    const ca_real tolerance = CA_EXACT_TOLERANCE * ca_max(1, ca_length(m, wrench));
    if (!ca_within(p, ca_length(m, missed), tolerance, CA_REAL(0.5), thrusts)) {
        ca_settle(p, wrench, tolerance, thrusts, steps);
        ca_leave(p, wrench, thrusts, missed);
    }
    for (int k = 0; k < m; k++)
        served->face.wrench[k] = wrench[k] - missed[k];
    ca_judge(p, u, (ca_real)share, (ca_real)(ERROR_FACTOR * s.doubt), served);
    return 1;
}

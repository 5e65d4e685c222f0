/* Least-norm thrusts within bounds, Eqs. (20)-(22), by a dual Newton method.
 *
 * The cost is separable, so for given multipliers y of basis^T f = c the optimal thrusts are
 * f(y) = clip(basis y). The remaining equation basis^T f(y) = c is piecewise linear, and it is the
 * gradient of a concave function, the dual. Newton's method starts at the pseudo-inverse, y = c,
 * treats the rotors between their bounds as free, and searches exactly along each step.
 */
#include "numbers.h"

/* Bounds of Newton's iteration: for any wrench, and for a wrench known to be attainable. */
#define ATTEMPT 10
#define STEPS 50
/* Number of steps without a smaller residual after which the iteration ends. */
#define IDLE 16
/* Number of steps along axes that the free rotors do not span after which u is considered likely
 * to be unattainable. */
#define STRAYS 1
/* Norm of a column of the free rows of the basis below which they do not span an axis. */
#define FLAT CA_CHOOSE(1e-8, 1e-4)
/* Least pivot of well-conditioned normal equations. */
#define WELL CA_CHOOSE(1e-2, 3e-2)
/* Multipliers above this, in units of the greatest thrust, indicate almost parallel facets. */
#define STEEP CA_CHOOSE(2e4, 2e2)
/* Multiple of STEEP at which a relaxed solution uses the whole slack. */
#define SOFT CA_REAL(0.05)
/* Change of a thrust, in units of the greatest thrust, for which no slack is used. */
#define SAME CA_CHOOSE(1e-7, 1e-4)
/* Rounding error of thrusts that are computed from y, as a share of |y|. */
#define ROUNDING CA_CHOOSE(16 * 2.2e-16, 16 * 1.2e-7)
/* Difference of thrusts that counts as a change of the active set. */
#define CHANGED CA_CHOOSE(1e-10, 1e-5)
/* Share of the fastest rate below which a rotor does not move along a step. */
#define STILL CA_CHOOSE(1e-12, 1e-6)
/* Rounding error of a sum along a step, as a share of its terms. */
#define SUM CA_CHOOSE(1e-14, 1e-6)

/* A relaxed program has one more actuator for each axis: the error of the axis. */
#define WIDE (CA_N + CA_M)

typedef struct {
    const ca_problem *problem;
    int count;                     /* n, or n + m if relaxed */
    const ca_real (*basis)[CA_M];
    const ca_real *lower, *upper;
    ca_real rate;                  /* of the actuators beyond n */
} bounded_program;

/* The factors Q R of the free rows of the basis, with the columns in the order of `axis`. If the
 * rows do not span all axes, also the factors P T of R^T. */
typedef struct {
    int free, rank;
    int axis[CA_M];
    ca_real q[CA_M][WIDE];
    ca_real r[CA_M][CA_M];
    ca_real p[CA_M][CA_M];
    ca_real t[CA_M][CA_M];
} qr_factors;

static void factorize(const bounded_program *program, const int *free, int count, qr_factors *f)
{
    const int m = CA_AXES(program->problem);
    f->free = count;
    f->rank = m;
    for (int k = 0; k < m; k++) {
        f->axis[k] = k;
        for (int i = 0; i < count; i++)
            f->q[k][i] = program->basis[free[i]][k];
    }
    for (int j = 0; j < m; j++) {
        ca_real greatest = -1;
        int pivot = j;
        for (int k = j; k < m; k++) {
            const ca_real size = ca_dot(count, f->q[k], f->q[k]);
            if (size > greatest) {
                greatest = size;
                pivot = k;
            }
        }
        if (pivot != j) {
            const int axis = f->axis[j];
            f->axis[j] = f->axis[pivot];
            f->axis[pivot] = axis;
            for (int i = 0; i < count; i++) {
                const ca_real entry = f->q[j][i];
                f->q[j][i] = f->q[pivot][i];
                f->q[pivot][i] = entry;
            }
            for (int i = 0; i < j; i++) {
                const ca_real entry = f->r[i][j];
                f->r[i][j] = f->r[i][pivot];
                f->r[i][pivot] = entry;
            }
        }
        const ca_real length = ca_sqrt(greatest);
        if (!(length > FLAT)) {
            f->rank = j;
            break;
        }
        f->r[j][j] = length;
        const ca_real inverse = 1 / length;
        for (int i = 0; i < count; i++)
            f->q[j][i] *= inverse;
        for (int k = j + 1; k < m; k++) {
            const ca_real share = ca_dot(count, f->q[j], f->q[k]);
            f->r[j][k] = share;
            for (int i = 0; i < count; i++)
                f->q[k][i] -= share * f->q[j][i];
        }
    }
    if (f->rank == m)
        return;
    for (int j = 0; j < f->rank; j++) {
        for (int k = 0; k < m; k++)
            f->p[j][k] = k < j ? 0 : f->r[j][k];
        for (int i = 0; i < j; i++) {
            const ca_real share = ca_dot(m, f->p[i], f->p[j]);
            f->t[i][j] = share;
            for (int k = 0; k < m; k++)
                f->p[j][k] -= share * f->p[i][k];
        }
        f->t[j][j] = ca_length(m, f->p[j]);
        for (int k = 0; k < m; k++)
            f->p[j][k] /= f->t[j][j];
    }
}

/* Solve basis_F^T basis_F step = slopes without squaring the condition number; change = basis_F
 * step. `away` is the part of `slopes` that the free rows do not span. */
static void solve_free(const qr_factors *f, int m, const ca_real *slopes, ca_real *step,
                       ca_real *change, ca_real *away)
{
    ca_real sorted[CA_M], g[CA_M] = {0}, t[CA_M];
    const int rank = f->rank;
    for (int k = 0; k < m; k++)
        sorted[k] = slopes[f->axis[k]];
    for (int k = 0; k < m; k++)
        away[k] = 0;
    if (rank == m) {
        for (int j = 0; j < m; j++) {
            ca_real sum = sorted[j];
            for (int i = 0; i < j; i++)
                sum -= f->r[i][j] * g[i];
            g[j] = sum / f->r[j][j];
        }
        for (int j = m - 1; j >= 0; j--) {
            ca_real sum = g[j];
            for (int k = j + 1; k < m; k++)
                sum -= f->r[j][k] * t[k];
            t[j] = sum / f->r[j][j];
            step[f->axis[j]] = t[j];
        }
    } else {
        ca_real served[CA_M];
        for (int k = 0; k < m; k++)
            served[k] = 0;
        for (int j = rank - 1; j >= 0; j--) {
            const ca_real share = ca_dot(m, f->p[j], sorted);
            ca_real sum = share;
            for (int k = 0; k < m; k++)
                served[k] += share * f->p[j][k];
            for (int i = j + 1; i < rank; i++)
                sum -= f->t[j][i] * g[i];
            g[j] = sum / f->t[j][j];
        }
        for (int k = 0; k < m; k++) {
            away[f->axis[k]] = sorted[k] - served[k];
            served[k] = 0;
        }
        for (int j = 0; j < rank; j++) {
            ca_real sum = g[j];
            for (int i = 0; i < j; i++)
                sum -= f->t[i][j] * t[i];
            t[j] = sum / f->t[j][j];
            for (int k = 0; k < m; k++)
                served[k] += t[j] * f->p[j][k];
        }
        for (int k = 0; k < m; k++)
            step[f->axis[k]] = served[k];
    }
    for (int i = 0; i < f->free; i++)
        change[i] = 0;
    for (int j = 0; j < rank; j++)
        for (int i = 0; i < f->free; i++)
            change[i] += g[j] * f->q[j][i];
}

/* left = u - A f */
static void leave(const bounded_program *program, const ca_real *u, const ca_real *f, ca_real *left)
{
    const ca_problem *problem = program->problem;
    const int n = CA_ROTORS(problem), m = CA_AXES(problem);
    ca_residual(problem, u, f, left);
    if (program->count > n)
        for (int k = 0; k < m; k++)
            left[k] -= program->rate * ca_dot(m, problem->back[k], f + n);
}

/* y = matrix x for a lower triangle, as `coordinates` and `back` are. */
static void multiply(int m, const ca_real matrix[CA_M][CA_M], const ca_real *x, ca_real *y)
{
    for (int k = 0; k < m; k++)
        y[k] = ca_dot(k + 1, matrix[k], x);
}

/* Solve basis_F^T basis_F step = slopes by its normal equations; 0 if they are ill-conditioned. */
static int solve_normal(const bounded_program *program, const int *free, int frees,
                        const int *bound, const ca_real *slopes, ca_real *step)
{
    const int m = CA_AXES(program->problem), bounds = program->count - frees;
    ca_real h[CA_M][CA_M], inverse[CA_M] = {0};
    if (frees < m)
        return 0;
    /* basis^T basis is the identity, so either the free or the other rows can be summed. */
    const int few = bounds < frees, count = few ? bounds : frees;
    const int *rotors = few ? bound : free;
    const ca_real sign = few ? CA_REAL(-1) : CA_REAL(1);
    const ca_real whole = few ? 1 + program->rate * program->rate : 0;
    for (int k = 0; k < m; k++)
        for (int j = 0; j <= k; j++)
            h[k][j] = j == k ? whole : 0;
    for (int i = 0; i < count; i++) {
        const ca_real *row = program->basis[rotors[i]];
        for (int k = 0; k < m; k++) {
            const ca_real entry = sign * row[k];
            for (int j = 0; j <= k; j++)
                h[k][j] += entry * row[j];
        }
    }
    /* L D L^T; the lower triangle of h becomes L. */
    for (int k = 0; k < m; k++) {
        for (int j = 0; j < k; j++) {
            ca_real sum = h[k][j];
            for (int i = 0; i < j; i++)
                sum -= h[k][i] * h[j][i];
            h[k][j] = sum;
        }
        ca_real pivot = h[k][k];
        for (int j = 0; j < k; j++) {
            const ca_real entry = h[k][j] * inverse[j];
            pivot -= entry * h[k][j];
            h[k][j] = entry;
        }
        if (!(pivot > WELL))
            return 0;
        inverse[k] = 1 / pivot;
    }
    for (int k = 0; k < m; k++) {
        ca_real sum = slopes[k];
        for (int j = 0; j < k; j++)
            sum -= h[k][j] * step[j];
        step[k] = sum;
    }
    for (int k = m - 1; k >= 0; k--) {
        ca_real sum = step[k] * inverse[k];
        for (int j = k + 1; j < m; j++)
            sum -= h[j][k] * step[j];
        step[k] = sum;
    }
    return 1;
}

static void multiply_basis(const bounded_program *program, const ca_real *y, ca_real *z)
{
    const int m = CA_AXES(program->problem);
    for (int i = 0; i < program->count; i++)
        z[i] = ca_dot(m, program->basis[i], y);
}

typedef struct {
    int count;
    ca_real start[WIDE], rate[WIDE], lower[WIDE], upper[WIDE];
    ca_real corner[2 * WIDE + 1];
} search_line;

/* rate . clip(start + t rate) - goal, which grows with t */
static ca_real excess(const search_line *line, ca_real t, ca_real goal)
{
    ca_real sum = 0;
    for (int i = 0; i < line->count; i++)
        sum += ca_clip(line->start[i] + t * line->rate[i], line->lower[i], line->upper[i]) *
               line->rate[i];
    return sum - goal;
}

/* Return t >= 0 at which the excess is zero. If every rotor reaches a bound before that,
 * `short_of` is the remaining gap: the wrench is unattainable. */
static ca_real search(const bounded_program *program, const ca_real *z, const ca_real *rates,
                      ca_real goal, ca_real *short_of)
{
    search_line line;
    ca_real fastest = 0, rounding = 0;
    int corners = 1, low, high;

    *short_of = 0;
    for (int i = 0; i < program->count; i++)
        fastest = ca_max(fastest, ca_abs(rates[i]));
    line.count = 0;
    line.corner[0] = 0;
    for (int i = 0; i < program->count; i++) {
        const ca_real size = ca_abs(rates[i]);
        /* The corner of a rotor that moves only by rounding would be far away. */
        if (!(size > STILL * fastest))
            continue;
        const ca_real lower = program->lower[i], upper = program->upper[i];
        const ca_real inverse = 1 / rates[i];
        const ca_real ends[2] = {(lower - z[i]) * inverse, (upper - z[i]) * inverse};
        for (int e = 0; e < 2; e++) {
            if (!(ends[e] > 0))
                continue;
            int place = corners++;
            for (; place > 1 && line.corner[place - 1] > ends[e]; place--)
                line.corner[place] = line.corner[place - 1];
            line.corner[place] = ends[e];
        }
        line.start[line.count] = z[i];
        line.rate[line.count] = rates[i];
        line.lower[line.count] = lower;
        line.upper[line.count++] = upper;
        rounding += size * ca_max(ca_abs(lower), ca_abs(upper));
    }
    rounding *= SUM;
    /* On the boundary of the admissible set the goal is reached at a corner and kept beyond it: the
     * search ends at the corner. `low` is a corner before the goal, `high` one at or after it. */
    low = -1;
    high = corners;
    ca_real before = 0, after = 0;
    while (high - low > 1) {
        const int middle = (low + high) / 2;
        const ca_real value = excess(&line, line.corner[middle], goal);
        if (value >= -rounding) {
            high = middle;
            after = value;
        } else {
            low = middle;
            before = value;
        }
    }
    if (high == 0)
        return 0;
    if (high == corners) {
        *short_of = -before;
        return 2 * line.corner[corners - 1];
    }
    const ca_real share = ca_min(before / (before - after), 1);
    return line.corner[low] + share * (line.corner[high] - line.corner[low]);
}

static void copy(int count, const ca_real *from, ca_real *to)
{
    for (int i = 0; i < count; i++)
        to[i] = from[i];
}

/* Newton's iteration, from the multipliers or, if `start` is zero, from the pseudo-inverse. Returns
 * the least residual of all iterates, with its thrusts and multipliers. With `early` it stops when
 * u is proven or likely to be unattainable. Then the thrusts are not set, and another iteration can
 * continue from the multipliers. */
static ca_real iterate(const bounded_program *program, const ca_real *u, ca_real tolerance,
                       int start, int early, int bound, ca_real *thrusts, ca_real *multipliers,
                       int *steps)
{
    const ca_problem *problem = program->problem;
    const int m = CA_AXES(problem), count = program->count;
    ca_real target[CA_M], y[CA_M], least = CA_INFINITY;
    int strays = 0, idle = 0;
    multiply(m, problem->coordinates, u, target);
    copy(m, start ? multipliers : target, y);

    if (early)
        copy(m, y, multipliers);
    for (int number = 0; number < bound; number++) {
        ca_real z[WIDE], f[WIDE], left[CA_M], residual;
        int free[WIDE], held[WIDE], frees = 0, helds = 0;
        for (int i = 0; i < count; i++) {
            const ca_real lower = program->lower[i], upper = program->upper[i];
            z[i] = ca_dot(m, program->basis[i], y);
            f[i] = ca_clip(z[i], lower, upper);
            if (z[i] > lower && z[i] < upper)
                free[frees++] = i;
            else
                held[helds++] = i;
        }
        leave(program, u, f, left);
        residual = ca_length(m, left);
        /* In single precision, steps rarely help if rounding errors of y exceed the tolerance. */
        const int uncertain = CA_CHOOSE_INT(0, ROUNDING * ca_length(m, y) > 16 * tolerance);
        idle = residual < (uncertain ? least / 2 : least) ? 0 : idle + 1;
        if (idle > (uncertain ? IDLE / 4 : IDLE))
            break;
        if (residual <= tolerance || (!early && residual < least)) {
            least = residual;
            copy(count, f, thrusts);
            copy(m, y, multipliers);
            if (residual <= tolerance)
                break;
        }
        /* With as many rotors as axes there is only one solution. */
        if (early && count == m)
            break;

        ca_real slopes[CA_M], step[CA_M], away[CA_M], rates[WIDE], change[WIDE];
        int astray = 0;
        ++*steps;
        multiply(m, problem->coordinates, left, slopes);
        if (solve_normal(program, free, frees, held, slopes, step)) {
            multiply_basis(program, step, rates);
            for (int i = 0; i < frees; i++)
                change[i] = rates[free[i]];
        } else {
            qr_factors factors;
            ca_real missed[CA_M];
            factorize(program, free, frees, &factors);
            solve_free(&factors, m, slopes, step, change, away);
            /* Along an axis that the free rotors do not span, the residual is either a rounding
             * error, which is ignored, or the step goes along this axis until the next rotor
             * becomes free. */
            multiply(m, problem->back, away, missed);
            astray = factors.rank < m && ca_length(m, missed) > CA_REAL(0.8) * tolerance;
            if (astray && early && ++strays > STRAYS)
                break;
            multiply_basis(program, step, rates);
        }
        if (!astray) {
            /* If the step does not change the active set, it ends at the solution. Adding the step
             * to the thrusts loses fewer digits than adding it to y, which may be large. */
            ca_real after[CA_M], greatest = 0, change_of_set = 0;
            for (int k = 0; k < m; k++)
                after[k] = y[k] + step[k];
            for (int i = 0; i < frees; i++) {
                const int rotor = free[i];
                const ca_real lower = program->lower[rotor], upper = program->upper[rotor];
                const ca_real aimed = ca_clip(z[rotor] + rates[rotor], lower, upper);
                f[rotor] = ca_clip(f[rotor] + change[i], lower, upper);
                change_of_set = ca_max(change_of_set, ca_abs(aimed - f[rotor]));
            }
            for (int i = 0; i < helds; i++) {
                const int rotor = held[i];
                const ca_real aimed = ca_clip(z[rotor] + rates[rotor], program->lower[rotor],
                                              program->upper[rotor]);
                change_of_set = ca_max(change_of_set, ca_abs(aimed - f[rotor]));
            }
            for (int i = 0; i < count; i++)
                greatest = ca_max(greatest, ca_abs(f[i]));
            if (change_of_set <= CHANGED * (1 + greatest) + ROUNDING * ca_length(m, after)) {
                leave(program, u, f, left);
                residual = ca_length(m, left);
                if (residual <= tolerance || (!early && residual < least)) {
                    least = residual;
                    copy(count, f, thrusts);
                    copy(m, after, multipliers);
                    if (residual <= tolerance)
                        break;
                }
            }
        }
        ca_real advance = 0, short_of = 0;
        const ca_real *way = step;
        if (astray) {
            ca_real ways[WIDE];
            way = away;
            multiply_basis(program, away, ways);
            advance = search(program, z, ways, ca_dot(m, target, away), &short_of);
        }
        if (!(advance > 0)) {
            way = step;
            advance = search(program, z, rates, ca_dot(m, target, step), &short_of);
        }
        if (!(advance > 0))
            break;
        if (early && short_of > 0) {
            /* All attainable wrenches are on one side of a plane. Compute the distance of u. */
            ca_real normal[CA_M];
            for (int k = 0; k < m; k++) {
                normal[k] = 0;
                for (int j = k; j < m; j++)
                    normal[k] += problem->coordinates[j][k] * way[j];
            }
            if (short_of > 4 * tolerance * ca_length(m, normal))
                break;
        }
        for (int k = 0; k < m; k++)
            y[k] += advance * way[k];
        if (early)
            copy(m, y, multipliers);
    }
    return least;
}

ca_real ca_settle(const ca_problem *problem, const ca_real *u, ca_real tolerance, ca_real *thrusts,
                  int *steps)
{
    const int n = CA_ROTORS(problem), m = CA_AXES(problem);
    const bounded_program program = {problem, n, problem->basis, problem->lower, problem->upper, 0};
    ca_real f[CA_N], least = CA_INFINITY;
    for (int i = 0; i < n; i++)
        f[i] = thrusts[i];
    for (int number = 0; number < CA_CHOOSE_INT(n, 3); number++) {
        ca_real left[CA_M], slopes[CA_M], step[CA_M], away[CA_M], change[CA_N];
        int free[CA_N], frees = 0;
        qr_factors factors;
        ca_residual(problem, u, f, left);
        const ca_real residual = ca_length(m, left);
        if (residual < least) {
            least = residual;
            copy(n, f, thrusts);
        }
        for (int i = 0; i < n; i++)
            if (f[i] > problem->lower[i] && f[i] < problem->upper[i])
                free[frees++] = i;
        if (residual <= tolerance || frees == 0)
            break;
        ++*steps;
        factorize(&program, free, frees, &factors);
        multiply(m, problem->coordinates, left, slopes);
        solve_free(&factors, m, slopes, step, change, away);
        for (int i = 0; i < frees; i++)
            f[free[i]] = ca_clip(f[free[i]] + change[i], problem->lower[free[i]],
                                 problem->upper[free[i]]);
    }
    return least;
}

/* If the multipliers y are large, allow an error of u up to the slack for smaller thrusts. */
static void relax(const ca_problem *problem, const ca_real *u, ca_real tolerance, ca_real *thrusts,
                  const ca_real *y, int *steps)
{
    const int n = CA_ROTORS(problem), m = CA_AXES(problem);
    const ca_real steep = STEEP * problem->greatest;
    const ca_real slack = problem->slack * ca_max(1, ca_length(m, u));
    if (!(tolerance < slack && ca_length(m, y) > steep))
        return;
    /* One more actuator for each axis stands for its error. */
    ca_real basis[WIDE][CA_M], lower[WIDE], upper[WIDE], f[WIDE], multipliers[CA_M];
    ca_real norm = 0, difference = 0;
    for (int k = 0; k < m; k++)
        norm += ca_dot(m, problem->back[k], problem->back[k]);
    const ca_real room = slack / ca_sqrt(CA_REAL(m) * norm);
    const ca_real rate = ca_sqrt(room / (SOFT * steep));
    for (int i = 0; i < n; i++) {
        lower[i] = problem->lower[i];
        upper[i] = problem->upper[i];
        for (int k = 0; k < m; k++)
            basis[i][k] = problem->basis[i][k];
    }
    for (int k = 0; k < m; k++) {
        upper[n + k] = room / rate;
        lower[n + k] = -upper[n + k];
        for (int j = 0; j < m; j++)
            basis[n + k][j] = j == k ? rate : 0;
    }
    const bounded_program relaxed = {problem, n + m, (const ca_real (*)[CA_M])basis, lower, upper,
                                     rate};
    ca_real missed[CA_M];
    iterate(&relaxed, u, tolerance / 2, 0, 0, STEPS, f, multipliers, steps);
    ca_residual(problem, u, f, missed);
    /* On the boundary multipliers may be large although slack changes nothing. */
    for (int i = 0; i < n; i++)
        difference = ca_max(difference, ca_abs(f[i] - thrusts[i]));
    if (difference > SAME * problem->greatest && ca_length(m, missed) <= slack)
        copy(n, f, thrusts);
}

ca_real ca_attempt(const ca_problem *problem, const ca_real *u, ca_real tolerance,
                   ca_real *thrusts, ca_real *y, int *steps)
{
    const bounded_program plain = {
        problem, CA_ROTORS(problem), problem->basis, problem->lower, problem->upper, 0};
    const ca_real residual =
        iterate(&plain, u, tolerance / 2, 0, 1, ATTEMPT, thrusts, y, steps);
    if (residual <= tolerance)
        relax(problem, u, tolerance, thrusts, y, steps);
    return residual;
}

ca_real ca_least_norm(const ca_problem *problem, const ca_real *u, ca_real tolerance, int start,
                      ca_real *thrusts, ca_real *y, int *steps)
{
    const bounded_program plain = {
        problem, CA_ROTORS(problem), problem->basis, problem->lower, problem->upper, 0};
    ca_real residual = iterate(&plain, u, tolerance / 2, start, 0, STEPS, thrusts, y, steps);
    if (residual > tolerance / 2)
        residual = ca_settle(problem, u, tolerance / 2, thrusts, steps);
    if (residual <= tolerance)
        relax(problem, u, tolerance, thrusts, y, steps);
    return residual;
}

ca_real ca_least_norm_on_face(const ca_problem *problem, const ca_served *served,
                              ca_real tolerance, ca_real *thrusts, int *steps)
{
    const int n = CA_ROTORS(problem), m = CA_AXES(problem);
    ca_real lower[CA_N], upper[CA_N], f[CA_N], left[CA_M], slopes[CA_M], y[CA_M], away[CA_M];
    ca_real change[CA_N];
    int free[CA_N], frees = 0;
    qr_factors factors;
    /* With the held thrusts fixed, the multipliers are small. */
    for (int i = 0; i < n; i++) {
        lower[i] = served->held[i] ? served->thrusts[i] : problem->lower[i];
        upper[i] = served->held[i] ? served->thrusts[i] : problem->upper[i];
        f[i] = lower[i] < upper[i] ? 0 : lower[i];
        if (lower[i] < upper[i])
            free[frees++] = i;
    }
    if (served->least) {
        for (int i = 0; i < n; i++)
            thrusts[i] = served->thrusts[i];
        ca_residual(problem, served->wrench, thrusts, left);
        return ca_length(m, left);
    }
    const bounded_program face = {problem, n, problem->basis, lower, upper, 0};
    ++*steps;
    factorize(&face, free, frees, &factors);
    ca_residual(problem, served->wrench, f, left);
    multiply(m, problem->coordinates, left, slopes);
    solve_free(&factors, m, slopes, y, change, away);
    return iterate(&face, served->wrench, tolerance / 2, 1, 0, STEPS, thrusts, y, steps);
}

/* Least-norm thrusts within bounds, Eqs. (20)-(22), by a dual Newton method.
 *
 * The cost is |g|^2 with the deviations g = weight (f - preferred) of the thrusts. It is separable,
 * so for given multipliers y of basis^T g = c the optimal deviations are g(y) = clip(basis y). The
 * remaining equation basis^T g(y) = c is piecewise linear, and it is the gradient of a concave
 * function, the dual. Newton's method starts at the pseudo-inverse, y = c, treats the rotors
 * between their bounds as free, and searches exactly along each step. The residual is that of the
 * thrusts and the given wrench, so that preferred thrusts far away take no digits from it.
 */
#include "least_norm.h"
#include "numbers.h"

/* Bounds of Newton's iteration: for any wrench, and for a wrench known to be attainable. */
#define ATTEMPT 10
#define STEPS 50
/* Number of steps without a smaller residual after which the iteration ends. */
#define IDLE 16
/* Number of steps along axes that the free rotors do not span after which each further one tries to
 * prove that u is unattainable. */
#define STRAYS 1
/* Norm of a column of the free rows of the basis below which they do not span an axis. */
#define SINGULAR_MIN CA_CHOOSE(1e-8, 1e-4)
/* Distance of a free row from the span of others below which it is in the span. */
#define DEPENDENT CA_CHOOSE(1e-13, 1e-4)
/* Share of a vector below which it is computed again, since rounding errors of the rest count. */
#define SMALL CA_REAL(1e-3)
/* Least pivot of well-conditioned normal equations. */
#define WELL CA_CHOOSE(1e-2, 3e-2)
/* Multipliers above this, in units of the greatest thrust, indicate almost parallel facets. */
#define STEEP CA_CHOOSE(2e4, 2e2)
/* Multiple of STEEP at which a relaxed solution uses the whole slack. */
#define FULL_SLACK CA_REAL(0.05)
/* Change of a thrust, in units of the greatest thrust, for which no slack is used. */
#define SAME CA_CHOOSE(1e-7, 1e-4)
/* Rounding error of thrusts that are computed from y, as a share of |y|. */
#define IMAGE_ROUNDING CA_CHOOSE(16 * 2.2e-16, 16 * 1.2e-7)
/* Difference of thrusts that counts as a change of the active set. */
#define CHANGED CA_CHOOSE(1e-10, 1e-5)
/* Share of the fastest rate below which a rotor does not move along a step. */
#define STILL CA_CHOOSE(1e-12, 1e-6)
/* Rounding error of a sum along a step, as a share of its terms. */
#define SUM CA_CHOOSE(1e-14, 1e-6)
/* Rounding error of Gamma f that counts as exact, as a share of |Gamma| |f|. */
#define EXACT_SUM CA_CHOOSE(4 * 2.2e-16, 4 * 1.2e-7)

/* A relaxed program has one more actuator for each axis: the error of the axis. */
#define WIDE (CA_N + CA_M)

typedef struct {
    const ca_problem *problem;
    int count;                     /* n, or n + m if relaxed */
    const ca_real (*basis)[CA_M];
    const ca_real *lower, *upper;  /* bounds of the deviations */
    const ca_real *least, *most;   /* of the thrusts */
    ca_real rate;                  /* of the actuators beyond n */
} bounded_program;

static bounded_program program_of(const ca_problem *p)
{
    const bounded_program program = {p, CA_ROTORS(p), p->basis, p->deviation_lower,
                                     p->deviation_upper, p->lower, p->upper, 0};
    return program;
}

/* Thrusts of deviations. */
static void weigh(const bounded_program *program, const ca_real *g, ca_real *f)
{
    const ca_problem *p = program->problem;
    for (int i = 0; i < program->count; i++)
        f[i] = i >= CA_ROTORS(p)            ? g[i]
               : g[i] <= program->lower[i]  ? program->least[i]
               : g[i] >= program->upper[i]  ? program->most[i]
                                            : ca_clip(p->preferred[i] + g[i] / p->weight[i],
                                                      program->least[i], program->most[i]);
}

/* Solve h x = right for a positive definite matrix, given and overwritten in its lower triangle.
 * Returns 0 if it is ill-conditioned. */
static int solve_definite(int m, ca_real h[CA_M][CA_M], const ca_real *right, ca_real *x)
{
    ca_real inverse[CA_M] = {0};
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
        ca_real sum = right[k];
        for (int j = 0; j < k; j++)
            sum -= h[k][j] * x[j];
        x[k] = sum;
    }
    for (int k = m - 1; k >= 0; k--) {
        ca_real sum = x[k] * inverse[k];
        for (int j = k + 1; j < m; j++)
            sum -= h[j][k] * x[j];
        x[k] = sum;
    }
    return 1;
}

/* h += sign row row^T in its lower triangle */
static void add_square(int m, const ca_real *row, ca_real sign, ca_real h[CA_M][CA_M])
{
    for (int k = 0; k < m; k++) {
        const ca_real entry = sign * row[k];
        for (int j = 0; j <= k; j++)
            h[k][j] += entry * row[j];
    }
}

/* Solve basis_F^T basis_F step = slopes by its normal equations; 0 if they are ill-conditioned. */
static int solve_normal(const bounded_program *program, const int *free, int frees,
                        const int *bound, const ca_real *slopes, ca_real *step)
{
    const int m = CA_AXES(program->problem), bounds = program->count - frees;
    ca_real h[CA_M][CA_M];
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
    for (int i = 0; i < count; i++)
        add_square(m, program->basis[rotors[i]], sign, h);
    return solve_definite(m, h, slopes, step);
}

/* An orthonormal basis of the span of the free rows, if they do not span all axes. */
typedef struct {
    int rank;
    ca_real q[CA_M][CA_M];
} row_span;

/* Remove the part of a vector along a unit vector. */
static void remove_along(int m, const ca_real *unit, ca_real *vector)
{
    const ca_real share = ca_dot(m, unit, vector);
    for (int k = 0; k < m; k++)
        vector[k] -= share * unit[k];
}

/* Find the span by the Gram-Schmidt method, and the part `away` of `slopes` that is not in it.
 * Returns 0 if it is not clear, or all axes. */
static int find_span(const bounded_program *program, const int *free, int frees,
                     const ca_real *slopes, row_span *span, ca_real *away)
{
    const int m = CA_AXES(program->problem);
    ca_copy(m, slopes, away);
    span->rank = 0;
    for (int i = 0; i < frees; i++) {
        ca_real rest[CA_M];
        ca_copy(m, program->basis[free[i]], rest);
        for (int j = 0; j < span->rank; j++)
            remove_along(m, span->q[j], rest);
        const ca_real square = ca_dot(m, rest, rest);
        if (!(square > DEPENDENT * DEPENDENT))
            continue;
        if (!(square > WELL * WELL) || span->rank == m - 1)
            return 0;
        ca_real *row = span->q[span->rank++];
        const ca_real inverse = 1 / ca_sqrt(square);
        for (int k = 0; k < m; k++)
            row[k] = rest[k] * inverse;
        remove_along(m, row, away);
    }
    /* A part that is small beside the slopes has their rounding errors, and along it the free rotors
     * seem to move: remove it again. */
    const int rounded = ca_dot(m, away, away) < SMALL * SMALL * ca_dot(m, slopes, slopes);
    for (int j = 0; rounded && j < span->rank; j++)
        remove_along(m, span->q[j], away);
    return 1;
}

/* Solve basis_F^T basis_F step = slopes in the span; change = basis_F step. Returns 0 if the
 * equations are ill-conditioned. */
static int solve_in_span(const bounded_program *program, const int *free, int frees,
                         const row_span *span, const ca_real *slopes, ca_real *step,
                         ca_real *change)
{
    const int m = CA_AXES(program->problem), rank = span->rank;
    ca_real h[CA_M][CA_M], right[CA_M], shares[CA_M];
    for (int j = 0; j < rank; j++) {
        right[j] = ca_dot(m, span->q[j], slopes);
        for (int k = 0; k <= j; k++)
            h[j][k] = 0;
    }
    for (int i = 0; i < frees; i++) {
        for (int j = 0; j < rank; j++)
            shares[j] = ca_dot(m, span->q[j], program->basis[free[i]]);
        add_square(rank, shares, 1, h);
    }
    if (!solve_definite(rank, h, right, shares))
        return 0;
    for (int k = 0; k < m; k++)
        step[k] = 0;
    for (int j = 0; j < rank; j++)
        for (int k = 0; k < m; k++)
            step[k] += shares[j] * span->q[j][k];
    for (int i = 0; i < frees; i++)
        change[free[i]] = ca_dot(m, program->basis[free[i]], step);
    return 1;
}

/* The factors Q R of the free rows of the basis, with the columns in the order of `axis`. If the
 * rows do not span all axes, also the factors P T of R^T. */
typedef struct {
    const int *free;
    int count, rank;
    int axis[CA_M];
    ca_real q[CA_M][WIDE];
    ca_real r[CA_M][CA_M];
    ca_real p[CA_M][CA_M];
    ca_real t[CA_M][CA_M];
} qr_factors;

static void factorize(const bounded_program *program, const int *free, int count, qr_factors *f)
{
    const int m = CA_AXES(program->problem);
    f->free = free;
    f->count = count;
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
        if (!(length > SINGULAR_MIN)) {
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

static void solve_factors(const qr_factors *f, int m, const ca_real *slopes, ca_real *step,
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
    for (int i = 0; i < f->count; i++) {
        ca_real sum = 0;
        for (int j = 0; j < rank; j++)
            sum += g[j] * f->q[j][i];
        change[f->free[i]] = sum;
    }
}

/* The same, and `find_span`, by the QR factors: without squaring the condition number. */
static void solve_by_columns(const bounded_program *program, const int *free, int frees,
                             const ca_real *slopes, ca_real *step, ca_real *change, ca_real *away)
{
    qr_factors factors;
    factorize(program, free, frees, &factors);
    solve_factors(&factors, CA_AXES(program->problem), slopes, step, change, away);
}

/* Solve basis_F^T basis_F step = slopes; change = basis_F step. `away` is the part of `slopes` that
 * the free rows do not span. */
static void solve_free(const bounded_program *program, const int *free, int frees,
                       const ca_real *slopes, ca_real *step, ca_real *change, ca_real *away)
{
    row_span span;
    if (!find_span(program, free, frees, slopes, &span, away) ||
        !solve_in_span(program, free, frees, &span, slopes, step, change))
        solve_by_columns(program, free, frees, slopes, step, change, away);
}

void ca_leave(const ca_problem *p, const ca_real *u, const ca_real *f, ca_real *left)
{
    for (int k = 0; k < CA_AXES(p); k++)
        left[k] = u[k] - ca_dot(CA_ROTORS(p), p->gamma[k], f);
}

ca_real ca_rounding(const ca_problem *p, const ca_real *f)
{
    ca_real sizes[CA_M];
    for (int k = 0; k < CA_AXES(p); k++) {
        sizes[k] = 0;
        for (int i = 0; i < CA_ROTORS(p); i++)
            sizes[k] += ca_abs(p->gamma[k][i] * f[i]);
    }
    return EXACT_SUM * ca_length(CA_AXES(p), sizes);
}

int ca_within(const ca_problem *p, ca_real residual, ca_real tolerance, ca_real share,
              const ca_real *f)
{
    if (residual <= share * tolerance)
        return 1;
    return residual <= share * p->rounding && residual <= share * ca_rounding(p, f);
}

/* left = u - A f */
static void leave(const bounded_program *program, const ca_real *u, const ca_real *f, ca_real *left)
{
    const ca_problem *problem = program->problem;
    const int n = CA_ROTORS(problem), m = CA_AXES(problem);
    ca_leave(problem, u, f, left);
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

/* c of basis^T g = c; these are also the multipliers of the pseudo-inverse. */
static void aim(const ca_problem *p, const ca_real *u, ca_real *c)
{
    ca_real shifted[CA_M] = {0};
    for (int k = 0; k < CA_AXES(p); k++)
        shifted[k] = u[k] - p->offset[k];
    multiply(CA_AXES(p), p->coordinates, shifted, c);
}

static void multiply_basis(const bounded_program *program, const ca_real *y, ca_real *z)
{
    const int m = CA_AXES(program->problem);
    for (int i = 0; i < program->count; i++)
        z[i] = ca_dot(m, program->basis[i], y);
}

/* Return t >= 0 at which `excess`, which is negative at t = 0 and grows with t by
 * rates . (clip(z + t rates) - f), is zero. If every rotor reaches a bound before that, `short_of`
 * is the remaining gap: the wrench is unattainable. */
static ca_real search_along(const bounded_program *program, const ca_real *z, const ca_real *f,
                      const ca_real *rates, ca_real excess, ca_real *short_of)
{
    /* Each rotor moves between its bounds until `end`. `change` is where its slope changes next. */
    ca_real change[WIDE], end[WIDE], now[WIDE], later[WIDE];
    ca_real fastest = 0, rounding = 0, gain = 0, last = 0, t = 0;
    int count = 0;

    *short_of = 0;
    for (int i = 0; i < program->count; i++)
        fastest = ca_max(fastest, ca_abs(rates[i]));
    const ca_real still = STILL * fastest;
    for (int i = 0; i < program->count; i++) {
        const ca_real rate = rates[i], size = ca_abs(rate);
        /* The end of a rotor that moves only by rounding would be far away. */
        if (!(size > still))
            continue;
        const ca_real lower = program->lower[i], upper = program->upper[i];
        const ca_real inverse = 1 / rate, final = rate > 0 ? upper : lower;
        const ca_real until = (final - z[i]) * inverse;
        rounding += size * ca_max(ca_abs(lower), ca_abs(upper));
        if (!(until > 0 && lower < upper))
            continue;
        const ca_real start = ((rate > 0 ? lower : upper) - z[i]) * inverse;
        later[count] = rate * rate;
        now[count] = start > 0 ? 0 : later[count];
        change[count] = start > 0 ? start : until;
        end[count++] = until;
        gain += rate * (final - f[i]);
        last = ca_max(last, until);
    }
    /* On the boundary of the admissible set the goal is reached where a rotor reaches its bound, and
     * kept beyond it: the search ends there. */
    rounding *= SUM;
    if (excess >= -rounding)
        return 0;
    if (excess + gain < -rounding) {
        *short_of = -(excess + gain);
        return 2 * last;
    }
    for (int piece = 2 * count; piece > 0 && count > 0; piece--) {
        ca_real sum = 0, next = change[0];
        int first = 0;
        for (int i = 0; i < count; i++) {
            sum += now[i];
            if (change[i] < next) {
                next = change[i];
                first = i;
            }
        }
        const ca_real after = excess + sum * (next - t);
        if (after > 0)
            return ca_min(t - excess / sum, next);
        t = next;
        excess = after;
        if (after >= -rounding)
            break;
        if (change[first] < end[first]) {
            now[first] = later[first];
            change[first] = end[first];
        } else {
            count--;
            now[first] = now[count];
            later[first] = later[count];
            change[first] = change[count];
            end[first] = end[count];
        }
    }
    return t;
}

/* Newton's iteration, and the best of its iterates. */
typedef struct {
    const bounded_program *program;
    ca_search *search;    /* its y in: the first iterate; out: of the best or, if early, the last */
    ca_real *thrusts;     /* of the best iterate; if early only if within the tolerance */
    ca_real residual;     /* of the best iterate */
    int early;            /* whether to end after few steps, or when u is proven to be unattainable */
} newton;

/* The share of the tolerance that the iteration aims at: its answers are also exact with another
 * order of summation. */
#define AIM CA_REAL(0.5)

/* Keep an iterate if it is the best. Returns whether it is within the tolerance. */
static int keep(newton *it, ca_real residual, const ca_real *f, const ca_real *y)
{
    const ca_problem *problem = it->program->problem;
    const int done = ca_within(problem, residual, it->search->tolerance, AIM, f);
    if (done || (!it->early && residual < it->residual)) {
        it->residual = residual;
        ca_copy(it->program->count, f, it->thrusts);
        ca_copy(CA_AXES(problem), y, it->search->y);
    }
    return done;
}

/* If a step does not change the active set, set `after` to the thrusts f after the step. Adding
 * `change` to them loses fewer digits than adding the step to the multipliers, which may be large. */
static int completes(const bounded_program *program, const ca_real *z, const ca_real *rates,
                     const ca_real *g, const ca_real *f, const ca_real *change, ca_real limit,
                     ca_real *after)
{
    const ca_problem *problem = program->problem;
    for (int i = 0; i < program->count; i++) {
        const ca_real lower = program->lower[i], upper = program->upper[i];
        const ca_real aimed = z[i] + rates[i];
        if (z[i] > lower && z[i] < upper) {
            const ca_real end = ca_clip(g[i] + change[i], lower, upper);
            after[i] = !problem->weighted || i >= CA_ROTORS(problem) ? end
                       : end <= lower                              ? program->least[i]
                       : end >= upper                              ? program->most[i]
                                      : ca_clip(f[i] + change[i] / problem->weight[i],
                                                program->least[i], program->most[i]);
            if (ca_abs(aimed - end) > limit)
                return 0;
        } else {
            after[i] = f[i];
            if (ca_abs(ca_clip(aimed, lower, upper) - g[i]) > limit)
                return 0;
        }
    }
    return 1;
}

/* Set the plane along a direction of multipliers. */
static void set_plane(const ca_problem *problem, ca_search *search, const ca_real *way)
{
    const int m = CA_AXES(problem);
    ca_copy(m, way, search->toward);
    for (int k = 0; k < m; k++) {
        search->normal[k] = 0;
        for (int j = k; j < m; j++)
            search->normal[k] += problem->coordinates[j][k] * way[j];
    }
}

/* Whether a gap along a direction of multipliers proves that u is not attainable: all attainable
 * wrenches are on one side of a plane. */
static int proves(const ca_problem *problem, ca_search *search, const ca_real *way,
                  ca_real short_of)
{
    set_plane(problem, search, way);
    return short_of > search->tolerance * ca_length(CA_AXES(problem), search->normal);
}

/* The same for any multipliers: whether u is beyond a plane that touches the set along them. */
static int is_beyond(const ca_problem *p, ca_search *search, const ca_real *way)
{
    const int n = CA_ROTORS(p), m = CA_AXES(p);
    ca_real goal[CA_M], low = 0, high = 0, rounding = 0;
    aim(p, search->wrench, goal);
    for (int i = 0; i < n; i++) {
        const ca_real rate = ca_dot(m, p->basis[i], way);
        const ca_real a = rate * p->deviation_lower[i], b = rate * p->deviation_upper[i];
        low += ca_min(a, b);
        high += ca_max(a, b);
        rounding += ca_max(ca_abs(a), ca_abs(b));
    }
    const ca_real height = ca_dot(m, way, goal);
    const ca_real gap = ca_max(height - high, low - height) - SUM * rounding;
    return gap > 0 && proves(p, search, way, gap);
}

/* The row of the basis of the rotor that is furthest beyond its bounds. */
static const ca_real *furthest_row(const bounded_program *program, const ca_real *z)
{
    ca_real most = -1;
    int furthest = 0;
    for (int i = 0; i < program->count; i++) {
        const ca_real out = ca_max(program->lower[i] - z[i], z[i] - program->upper[i]);
        if (out > most) {
            most = out;
            furthest = i;
        }
    }
    return program->basis[furthest];
}

/* The step if the normal equations cannot be solved. Returns whether it goes along an axis that the
 * free rotors do not span, until the next rotor becomes free; then `change` is not set. */
static int solve_singular(bounded_program plain, ca_real tolerance, const ca_real *f,
                          const int *free, int frees, const ca_real *slopes, ca_real *step,
                          ca_real *change)
{
    const bounded_program *program = &plain;
    const int m = CA_AXES(plain.problem);
    ca_real away[CA_M], missed[CA_M];
    row_span span;
    const int spanned = find_span(program, free, frees, slopes, &span, away);
    if (!spanned)
        solve_by_columns(program, free, frees, slopes, step, change, away);
    multiply(m, program->problem->back, away, missed);
    /* A smaller residual along such an axis is a rounding error, which is ignored. */
    if (!ca_within(plain.problem, ca_length(m, missed), tolerance, CA_REAL(0.8) * AIM, f)) {
        ca_copy(m, away, step);
        return 1;
    }
    if (spanned && !solve_in_span(program, free, frees, &span, slopes, step, change))
        solve_by_columns(program, free, frees, slopes, step, change, away);
    return 0;
}

/* Search along the step for the axes that the free rotors span. */
static ca_real search_in_span(bounded_program plain, const int *free, int frees,
                               const ca_real *slopes, const ca_real *z, const ca_real *f,
                               ca_real *step, ca_real *rates, ca_real *short_of)
{
    const bounded_program *program = &plain;
    ca_real change[WIDE], away[CA_M];
    solve_free(program, free, frees, slopes, step, change, away);
    multiply_basis(program, step, rates);
    return search_along(program, z, f, rates, -ca_dot(CA_AXES(program->problem), step, slopes),
                  short_of);
}

static void iterate(newton *it)
{
    const bounded_program *program = it->program;
    const ca_problem *problem = program->problem;
    ca_search *search = it->search;
    const int m = CA_AXES(problem), count = program->count;
    ca_real y[CA_M] = {0}, z[WIDE];
    int strays = 0, idle = 0;

    it->residual = CA_UNBOUNDED;
    ca_copy(m, search->y, y);
    multiply_basis(program, y, z);
    for (int number = 0; number < (it->early ? ATTEMPT : STEPS); number++) {
        ca_real f[WIDE], deviations[WIDE], left[CA_M];
        const ca_real *g = f;
        int free[WIDE], held[WIDE], frees = 0, helds = 0;
        for (int i = 0; i < count; i++) {
            const ca_real lower = program->lower[i], upper = program->upper[i];
            f[i] = ca_clip(z[i], lower, upper);
            if (z[i] > lower && z[i] < upper)
                free[frees++] = i;
            else
                held[helds++] = i;
        }
        if (problem->weighted) {
            ca_copy(count, f, deviations);
            g = deviations;
            weigh(program, g, f);
        }
        leave(program, search->wrench, f, left);
        const ca_real residual = ca_length(m, left), least = it->residual;
        if (keep(it, residual, f, y))
            break;
        /* In single precision, steps rarely help if rounding errors of y exceed the tolerance. */
        const int uncertain = CA_CHOOSE_INT(
            0, IMAGE_ROUNDING * IMAGE_ROUNDING * ca_dot(m, y, y) >
                   64 * search->tolerance * search->tolerance);
        idle = residual < (uncertain ? least / 2 : least) ? 0 : idle + 1;
        if (it->early && count == m) {
            /* With as many rotors as axes there is only one solution. */
            search->unattainable = is_beyond(problem, search, furthest_row(program, z));
            break;
        }
        if (idle > (uncertain ? IDLE / 4 : IDLE))
            break;

        ca_real slopes[CA_M], step[CA_M], rates[WIDE], change[WIDE], short_of;
        ++*search->steps;
        multiply(m, problem->coordinates, left, slopes);
        const int normal = solve_normal(program, free, frees, held, slopes, step);
        const int astray = !normal && solve_singular(*program, search->tolerance, f, free, frees,
                                                     slopes, step, change);
        if (astray && it->early && ++strays > STRAYS) {
            search->unattainable =
                is_beyond(problem, search, step) || is_beyond(problem, search, y);
            if (search->unattainable)
                break;
        }
        multiply_basis(program, step, rates);
        if (!astray) {
            ca_real after[CA_M], goal[WIDE];
            for (int k = 0; k < m; k++)
                after[k] = y[k] + step[k];
            const ca_real limit =
                CHANGED * (1 + problem->greatest) + IMAGE_ROUNDING * ca_length(m, after);
            if (completes(program, z, rates, g, f, normal ? rates : change, limit, goal)) {
                leave(program, search->wrench, goal, left);
                if (keep(it, ca_length(m, left), goal, after))
                    return;
            }
        }
        ca_real advance =
            search_along(program, z, g, rates, -ca_dot(m, step, slopes), &short_of);
        if (!search->attainable && short_of > 0 &&
            proves(problem, search, step, short_of)) {
            search->unattainable = 1;
            break;
        }
        if (astray && !(advance > 0))
            advance = search_in_span(*program, free, frees, slopes, z, g, step, rates, &short_of);
        if (!(advance > 0))
            break;
        for (int k = 0; k < m; k++)
            y[k] += advance * step[k];
        for (int i = 0; i < count; i++)
            z[i] += advance * rates[i];
    }
    if (it->early && !(it->residual < CA_UNBOUNDED))
        ca_copy(m, y, search->y);
    else if (!it->early && !search->attainable && !search->unattainable)
        search->unattainable = is_beyond(problem, search, y);
}

/* One step towards a smaller residual by the free rotors. Newton's coordinates serve problems whose
 * axes are almost dependent; the axes themselves keep their digits where coordinates lose them. */
static void settle_once(const bounded_program *program, int in_axes, const int *free, int frees,
                        const ca_real *left, ca_real *f)
{
    const ca_problem *problem = program->problem;
    const int n = CA_ROTORS(problem), m = CA_AXES(problem);
    ca_real slopes[CA_M], step[CA_M], away[CA_M], change[CA_N];
    if (in_axes) {
        ca_real columns[CA_N][CA_M];
        bounded_program axes = *program;
        for (int k = 0; k < m; k++) {
            const ca_real length = ca_length(n, problem->gamma[k]);
            slopes[k] = left[k] / length;
            for (int i = 0; i < n; i++)
                columns[i][k] = problem->gamma[k][i] / length;
        }
        axes.basis = (const ca_real (*)[CA_M])columns;
        solve_by_columns(&axes, free, frees, slopes, step, change, away);
    } else {
        multiply(m, problem->coordinates, left, slopes);
        solve_free(program, free, frees, slopes, step, change, away);
        for (int j = 0; problem->weighted && j < frees; j++)
            change[free[j]] /= problem->weight[free[j]];
    }
    for (int j = 0; j < frees; j++) {
        const int i = free[j];
        f[i] = ca_clip(f[i] + change[i], program->least[i], program->most[i]);
    }
}

static int settle(const bounded_program *program, const ca_real *u, ca_real tolerance,
                  ca_real *thrusts, int *steps)
{
    const ca_problem *problem = program->problem;
    const int n = CA_ROTORS(problem), m = CA_AXES(problem);
    ca_real f[CA_N], least = CA_UNBOUNDED;
    for (int in_axes = 0; in_axes < 2; in_axes++) {
        ca_copy(n, thrusts, f);
        for (int number = 0; number < CA_CHOOSE_INT(n, 3); number++) {
            ca_real left[CA_M];
            int free[CA_N], frees = 0;
            ca_leave(problem, u, f, left);
            const ca_real residual = ca_length(m, left);
            if (residual < least) {
                least = residual;
                ca_copy(n, f, thrusts);
            }
            for (int i = 0; i < n; i++)
                if (f[i] > program->least[i] && f[i] < program->most[i])
                    free[frees++] = i;
            if (ca_within(problem, residual, tolerance, AIM, f)) {
                ca_copy(n, f, thrusts);
                return 1;
            }
            if (frees == 0)
                break;
            ++*steps;
            settle_once(program, in_axes, free, frees, left, f);
        }
        if (ca_within(problem, least, tolerance, 1, thrusts))
            return 1;
    }
    return 0;
}

int ca_settle(const ca_problem *problem, const ca_real *u, ca_real tolerance, ca_real *thrusts,
              int *steps)
{
    const bounded_program program = program_of(problem);
    return settle(&program, u, tolerance, thrusts, steps);
}

/* If the multipliers y are large, allow an error of u up to the slack for smaller thrusts. */
static void relax(const ca_problem *problem, ca_search *search, ca_real *thrusts)
{
    const int n = CA_ROTORS(problem), m = CA_AXES(problem);
    const ca_real steep = STEEP * problem->greatest;
    const ca_real slack = problem->slack * search->size;
    if (!(search->tolerance < slack && ca_length(m, search->y) > steep))
        return;
    /* One more actuator for each axis stands for its error. */
    ca_real basis[WIDE][CA_M], lower[WIDE], upper[WIDE], least[WIDE], most[WIDE], f[WIDE];
    ca_real norm = 0, difference = 0;
    for (int k = 0; k < m; k++)
        norm += ca_dot(m, problem->back[k], problem->back[k]);
    const ca_real room = slack / ca_sqrt(CA_REAL(m) * norm);
    const ca_real rate = ca_sqrt(room / (FULL_SLACK * steep));
    for (int i = 0; i < n; i++) {
        lower[i] = problem->deviation_lower[i];
        upper[i] = problem->deviation_upper[i];
        least[i] = problem->lower[i];
        most[i] = problem->upper[i];
        for (int k = 0; k < m; k++)
            basis[i][k] = problem->basis[i][k];
    }
    for (int k = 0; k < m; k++) {
        most[n + k] = upper[n + k] = room / rate;
        least[n + k] = lower[n + k] = -upper[n + k];
        for (int j = 0; j < m; j++)
            basis[n + k][j] = j == k ? rate : 0;
    }
    const bounded_program relaxed = {problem, n + m, (const ca_real (*)[CA_M])basis, lower, upper,
                                     least, most, rate};
    ca_real missed[CA_M];
    ca_search again;
    newton it = {&relaxed, &again, f, 0, 0};
    ca_start(problem, search->wrench, 1, search->steps, &again);
    again.tolerance = search->tolerance;
    iterate(&it);
    ca_leave(problem, search->wrench, f, missed);
    /* On the boundary multipliers may be large although slack changes nothing. */
    for (int i = 0; i < n; i++)
        difference = ca_max(difference, problem->weight[i] * ca_abs(f[i] - thrusts[i]));
    if (difference > SAME * problem->greatest && ca_length(m, missed) <= slack)
        ca_copy(n, f, thrusts);
}

void ca_start(const ca_problem *problem, const ca_real *u, int attainable, int *steps,
              ca_search *search)
{
    search->wrench = u;
    search->size = ca_max(1, ca_length(CA_AXES(problem), u));
    search->tolerance = CA_EXACT_TOLERANCE * search->size;
    search->attainable = attainable;
    search->unattainable = 0;
    search->steps = steps;
    aim(problem, u, search->y);
}

int ca_attempt(const ca_problem *problem, ca_search *search, ca_real *thrusts)
{
    const bounded_program program = program_of(problem);
    newton it = {&program, search, thrusts, 0, 1};
    iterate(&it);
    if (!(it.residual < CA_UNBOUNDED))
        return 0;
    relax(problem, search, thrusts);
    return 1;
}

int ca_least_norm(const ca_problem *problem, ca_search *search, ca_real *thrusts)
{
    const bounded_program program = program_of(problem);
    newton it = {&program, search, thrusts, 0, 0};
    iterate(&it);
    if (search->unattainable)
        return 0;
    if (ca_within(problem, it.residual, search->tolerance, AIM, thrusts) ||
        settle(&program, search->wrench, search->tolerance, thrusts, search->steps)) {
        relax(problem, search, thrusts);
        return 1;
    }
    search->unattainable = !search->attainable && is_beyond(problem, search, search->y);
    return 0;
}

/* Thrusts on a face miss its wrench where they are at their bounds. Turn its planes about the
 * thrusts that are not, towards the wrench, until a thrust of the face is no longer held: the
 * next facet. Returns 0 if this is not clear. */
static int turn(const ca_problem *p, const ca_face *face, int count, const ca_real *const *toward,
                const ca_real *f, ca_search *next)
{
    const bounded_program program = program_of(p);
    const int n = CA_ROTORS(p), m = CA_AXES(p);
    ca_real left[CA_M], slopes[CA_M] = {0}, away[CA_M], way[CA_M] = {0}, least = CA_UNBOUNDED;
    int free[CA_N], frees = 0;
    row_span span;
    for (int i = 0; i < n; i++)
        if (!face->held[i] && f[i] > p->lower[i] && f[i] < p->upper[i])
            free[frees++] = i;
    ca_leave(p, face->wrench, f, left);
    multiply(m, p->coordinates, left, slopes);
    if (!find_span(&program, free, frees, slopes, &span, away) ||
        !(ca_length(m, away) > CA_EXACT_TOLERANCE * p->greatest))
        return 0;
    for (int j = 0; j < count; j++)
        for (int k = 0; k < m; k++)
            way[k] += toward[j][k];
    for (int i = 0; i < n; i++) {
        const ca_real rate = ca_dot(m, p->basis[i], way), change = ca_dot(m, p->basis[i], away);
        if (face->held[i] && rate * change < 0)
            least = ca_min(least, -rate / change);
    }
    if (!(least < CA_UNBOUNDED))
        return 0;
    for (int k = 0; k < m; k++)
        way[k] += least * away[k];
    set_plane(p, next, way);
    return 1;
}

int ca_least_norm_at_once(const ca_problem *p, const ca_face *face, int count,
                          const ca_real *const *toward, ca_real *thrusts, ca_search *next)
{
    const int n = CA_ROTORS(p), m = CA_AXES(p);
    ca_real h[CA_M][CA_M] = {{0}}, f[CA_N] = {0}, left[CA_M], slopes[CA_M] = {0}, step[CA_M];
    int frees = 0, within = 1;
    for (int i = 0; i < n; i++)
        frees += !face->held[i] && p->lower[i] < p->upper[i];
    /* The free rows of the basis span all but `toward`. Either they or the others are summed. */
    const int few = n - frees < frees;
    for (int k = 0; k < m; k++)
        h[k][k] = few ? 1 : 0;
    for (int j = 0; j < count; j++)
        add_square(m, toward[j], 1 / ca_dot(m, toward[j], toward[j]), h);
    for (int i = 0; i < n; i++) {
        const int free = !face->held[i] && p->lower[i] < p->upper[i];
        f[i] = free ? p->preferred[i] : face->held[i] ? face->thrusts[i] : p->lower[i];
        if (free != few)
            add_square(m, p->basis[i], few ? CA_REAL(-1) : CA_REAL(1), h);
    }
    ++*next->steps;
    ca_leave(p, face->wrench, f, left);
    multiply(m, p->coordinates, left, slopes);
    const int spanned = solve_definite(m, h, slopes, step);
    for (int i = 0; i < n; i++) {
        if (face->held[i] || !(p->lower[i] < p->upper[i]))
            continue;
        const ca_real wanted =
            spanned ? f[i] + ca_dot(m, p->basis[i], step) / p->weight[i] : p->middle[i];
        f[i] = ca_clip(wanted, p->lower[i], p->upper[i]);
        within = within && spanned && ca_equal(f[i], wanted);
    }
    if (!within) {
        next->unattainable = frees + count <= m && turn(p, face, count, toward, f, next);
        return 0;
    }
    ca_leave(p, face->wrench, f, left);
    const ca_real tolerance = CA_EXACT_TOLERANCE * ca_max(1, ca_length(m, face->wrench));
    if (!ca_within(p, ca_length(m, left), tolerance, AIM, f))
        return 0;
    ca_copy(n, f, thrusts);
    return 1;
}

int ca_least_norm_on_face(const ca_problem *problem, const ca_face *face, ca_real *thrusts,
                          int *steps)
{
    const int n = CA_ROTORS(problem), m = CA_AXES(problem);
    ca_real lower[CA_N], upper[CA_N], least[CA_N], most[CA_N], f[CA_N], left[CA_M], slopes[CA_M];
    ca_real away[CA_M], change[CA_N];
    int free[CA_N], frees = 0;
    /* With the held thrusts fixed, the multipliers are small. */
    for (int i = 0; i < n; i++) {
        const ca_real held = face->thrusts[i];
        const ca_real deviation = problem->weight[i] * (held - problem->preferred[i]);
        least[i] = face->held[i] ? held : problem->lower[i];
        most[i] = face->held[i] ? held : problem->upper[i];
        lower[i] = face->held[i] ? deviation : problem->deviation_lower[i];
        upper[i] = face->held[i] ? deviation : problem->deviation_upper[i];
        f[i] = lower[i] < upper[i] ? problem->preferred[i] : least[i];
        if (lower[i] < upper[i])
            free[frees++] = i;
    }
    const bounded_program program = {problem, n, problem->basis, lower, upper, least, most, 0};
    ca_search search;
    newton it = {&program, &search, thrusts, 0, 0};
    ca_start(problem, face->wrench, 1, steps, &search);
    ++*steps;
    ca_leave(problem, face->wrench, f, left);
    multiply(m, problem->coordinates, left, slopes);
    solve_free(&program, free, frees, slopes, search.y, change, away);
    iterate(&it);
    return ca_within(problem, it.residual, search.tolerance, AIM, thrusts) ||
           settle(&program, face->wrench, search.tolerance, thrusts, steps);
}

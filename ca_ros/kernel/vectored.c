/* Projection on convex sets, the dual Newton method with it, and lines to the boundary. */
#include "vectored.h"
#include "numbers.h"

#define STEPS 60    /* of Newton's method */
#define TRIALS 60   /* of one search along a line */
#define PULLS 20    /* along one line to the boundary */
#define AIM CA_REAL(0.5)                /* share of the tolerance that Newton's method aims at */
#define SUM CA_CHOOSE(4 * 2.2e-16, 4 * 1.2e-7) /* rounding error of a sum, as a share of its terms */
#define FLAT CA_CHOOSE(1e-9, 1e-5)      /* curvature that counts as none, relative to the greatest */
#define DAMPING CA_REAL(0.01) /* of steps for a line, so that they are not much longer than y */
#define GROWTH 4 /* of the pull */
#define GAP CA_CHOOSE(2e-10, 1e-4)      /* by which a line may be too short, as a share of it */
#define PULL_MAX CA_CHOOSE(1e7, 1e3)    /* greatest weight of the length of a line */

/* The derivative of a projection, in the directions along the axis, across it, and around it. */
typedef struct {
    int inside;
    ca_real along, mixed, across, around; /* it; `mixed` is the entry beside the diagonal */
    ca_real away[2];                      /* the direction across */
} bend;

typedef struct {
    ca_real y[CA_M];     /* multipliers of the basis */
    ca_real x[CA_N];
    ca_real slope[CA_M]; /* of the dual: what is missing of the wrench, by the basis */
    ca_real size;        /* length of what is missing [N, N m], or of the slope for a line */
    bend bends[CA_N];
} iterate;

/* The point (to, up) of the flank or of the plane at `least` that is nearest to (a, c). */
static void beside_arc(const ca_vectored *p, int i, ca_real a, ca_real c, ca_real *to, ca_real *up,
                       bend *b)
{
    const ca_real on = a * p->cosine[i] + c * p->sine[i];
    const int has = p->flank[i] < p->radius[i];
    const ca_real held = ca_clip(on, p->flank[i], p->radius[i]);
    const ca_real fa = has ? held * p->cosine[i] : p->end_along[i];
    const ca_real fc = has ? held * p->sine[i] : p->end_across[i];
    const ca_real pc = ca_min(c, p->inner[i]), pa = p->least[i];
    const ca_real off = (a - fa) * (a - fa) + (c - fc) * (c - fc);
    const ca_real under = (a - pa) * (a - pa) + (c - pc) * (c - pc);
    b->along = b->mixed = b->across = 0;
    if (off <= under) {
        *to = fa;
        *up = fc;
        if (has && held >= on && held <= on) {
            b->along = p->cosine[i] * p->cosine[i];
            b->mixed = p->cosine[i] * p->sine[i];
            b->across = p->sine[i] * p->sine[i];
        }
        return;
    }
    *to = pa;
    *up = pc;
    b->across = c < p->inner[i];
}

/* Project the components of set i on it; b is the derivative. */
static void project(const ca_vectored *p, int i, int size, ca_real *x, bend *b)
{
    b->inside = 1;
    if (size == 1) {
        const ca_real held = ca_clip(*x, p->least[i], p->radius[i]);
        b->inside = *x > p->least[i] && *x < p->radius[i];
        b->along = b->mixed = b->across = b->around = 0;
        *x = held;
        return;
    }
    const ca_real r = p->radius[i], a = x[0];
    const ca_real c = size == 2 ? ca_abs(x[1]) : ca_sqrt(x[1] * x[1] + x[2] * x[2]);
    const ca_real square = a * a + c * c;
    const int full = p->full[i] > 0;
    if (square <= r * r &&
        (full || (c * p->cosine[i] <= a * p->sine[i] && a >= p->least[i])))
        return;
    ca_real to, up;
    b->inside = 0;
    if ((full || c * p->end_along[i] <= a * p->end_across[i]) && square > r * r) {
        const ca_real length = ca_sqrt(square), shrink = r / length;
        to = a * shrink;
        up = c * shrink;
        b->along = shrink * c * c / square;
        b->mixed = -shrink * a * c / square;
        b->across = shrink * a * a / square;
    } else {
        beside_arc(p, i, a, c, &to, &up, b);
    }
    const ca_real ratio = c > 0 ? up / c : 0;
    x[0] = to;
    b->away[0] = size == 2 ? (x[1] < 0 ? -1 : 1) : c > 0 ? x[1] / c : 1;
    b->away[1] = size == 3 && c > 0 ? x[2] / c : 0;
    b->around = c > 0 ? ratio : b->across;
    x[1] *= ratio;
    if (size == 3)
        x[2] *= ratio;
}

/* Greatest product of a vector of set i and a slope. */
static ca_real support(const ca_vectored *p, int i, int size, const ca_real *slope)
{
    if (size == 1)
        return ca_max(*slope * p->least[i], *slope * p->radius[i]);
    const ca_real a = slope[0];
    const ca_real c = size == 2 ? ca_abs(slope[1])
                                : ca_sqrt(slope[1] * slope[1] + slope[2] * slope[2]);
    if (p->full[i] > 0 || (c * p->end_along[i] <= a * p->end_across[i] && (a > 0 || c > 0)))
        return p->radius[i] * ca_sqrt(a * a + c * c);
    return ca_max(a * p->end_along[i] + c * p->end_across[i],
                  a * p->least[i] + c * p->inner[i]);
}

/* Wrench multipliers of multipliers of the basis. */
static void multipliers(const ca_vectored *p, const ca_real *y, ca_real *normal)
{
    const int m = (int)p->axes;
    for (int k = 0; k < m; k++) {
        normal[k] = 0;
        for (int l = 0; l < m; l++)
            normal[k] += y[l] * p->coordinates[l][k];
    }
}

/* Greatest product of an attainable wrench and the wrench multipliers of y. */
static ca_real height(const ca_vectored *p, const ca_real *y)
{
    const int m = (int)p->axes;
    ca_real sum = 0, slopes[3];
    for (int i = 0, j = 0; i < (int)p->sets; i++) {
        const int size = (int)p->size[i];
        for (int k = 0; k < size; k++, j++)
            slopes[k] = p->weight[j] * ca_dot(m, p->basis[j], y);
        sum += support(p, i, size, slopes);
    }
    return sum;
}

/* Set what belongs to at->y. With e, a unit vector, the wrench is free along it. */
static void evaluate(const ca_vectored *p, const ca_real *u, const ca_real *e, iterate *at)
{
    const int m = (int)p->axes, n = (int)p->components, sets = (int)p->sets;
    ca_real left[CA_M];
    for (int j = 0; j < n; j++)
        at->x[j] = p->preferred[j] + ca_dot(m, p->rates[j], at->y);
    for (int i = 0, j = 0; i < sets; j += (int)p->size[i], i++)
        project(p, i, (int)p->size[i], at->x + j, &at->bends[i]);
    for (int k = 0; k < m; k++)
        left[k] = u[k] - ca_dot(n, p->matrix[k], at->x);
    for (int k = 0; k < m; k++)
        at->slope[k] = ca_dot(m, p->coordinates[k], left);
    at->size = ca_length(m, left);
    if (e) {
        const ca_real along = ca_dot(m, at->slope, e);
        for (int k = 0; k < m; k++)
            at->slope[k] -= along * e[k];
        at->size = ca_length(m, at->slope);
    }
}

/* Whether what is missing is within a share of the tolerance or of the rounding error of B x. */
static int within(const ca_vectored *p, const iterate *at, ca_real tolerance, ca_real share)
{
    ca_real square = 0;
    if (at->size <= share * tolerance)
        return 1;
    for (int k = 0; k < (int)p->axes; k++) {
        ca_real sum = 0;
        for (int j = 0; j < (int)p->components; j++)
            sum += ca_abs(p->matrix[k][j] * at->x[j]);
        square += sum * sum;
    }
    return at->size <= share * SUM * ca_sqrt(square);
}

/* h = basis^T D basis, with the derivative D of the projection: the identity, and a term for each
 * vector that the projection has moved. */
static void curvature(const ca_vectored *p, const bend *bends, ca_real h[CA_M][CA_M])
{
    const int m = (int)p->axes;
    for (int k = 0; k < m; k++)
        for (int l = 0; l <= k; l++)
            h[k][l] = k == l;
    for (int i = 0, j = 0; i < (int)p->sets; j += (int)p->size[i], i++) {
        const bend *b = &bends[i];
        const int size = (int)p->size[i];
        if (b->inside)
            continue;
        const ca_real *along = p->basis[j];
        ca_real across[CA_M] = {0};
        for (int k = 0; size > 1 && k < m; k++) {
            across[k] = b->away[0] * p->basis[j + 1][k];
            if (size == 3)
                across[k] += b->away[1] * p->basis[j + 2][k];
        }
        const ca_real around = 1 - b->around;
        const ca_real last = size == 3 ? around - (1 - b->across) : b->across - 1;
        for (int k = 0; k < m; k++) {
            const ca_real first = (1 - b->along) * along[k] - b->mixed * across[k];
            const ca_real second = -b->mixed * along[k] - last * across[k];
            for (int l = 0; l <= k; l++) {
                h[k][l] -= first * along[l] + second * across[l];
                if (size == 3)
                    h[k][l] -= around * (p->basis[j + 1][k] * p->basis[j + 1][l] +
                                         p->basis[j + 2][k] * p->basis[j + 2][l]);
            }
        }
    }
}

/* Solve h way = slope; small pivots are raised. */
static void solve(int m, ca_real h[CA_M][CA_M], const ca_real *slope, ca_real *way)
{
    ca_real most = 0;
    for (int k = 0; k < m; k++)
        most = ca_max(most, h[k][k]);
    const ca_real floor = FLAT * ca_max(most, FLAT);
    /* h = L D L^T, with D on the diagonal of h. */
    for (int k = 0; k < m; k++) {
        for (int l = 0; l < k; l++) {
            for (int j = 0; j < l; j++)
                h[k][l] -= h[k][j] * h[l][j] * h[j][j];
            h[k][l] /= h[l][l];
            h[k][k] -= h[k][l] * h[k][l] * h[l][l];
        }
        h[k][k] = ca_max(h[k][k], floor);
    }
    for (int k = 0; k < m; k++) {
        way[k] = slope[k];
        for (int l = 0; l < k; l++)
            way[k] -= h[k][l] * way[l];
    }
    for (int k = m - 1; k >= 0; k--) {
        way[k] /= h[k][k];
        for (int l = k + 1; l < m; l++)
            way[k] -= h[l][k] * way[l];
    }
}

/* The same for a way normal to e, a unit vector. */
static void solve_beside(int m, ca_real h[CA_M][CA_M], const ca_real *e, const ca_real *slope,
                         ca_real more, ca_real *way)
{
    int q = 0;
    ca_real ratio[CA_M], less[CA_M][CA_M], gradient[CA_M] = {0}, part[CA_M];
    for (int k = 1; k < m; k++)
        q = ca_abs(e[k]) > ca_abs(e[q]) ? k : q;
    /* Component q of the way follows from the others. */
    for (int k = 0, r = 0; k < m; k++) {
        if (k == q)
            continue;
        ratio[r] = e[k] / e[q];
        gradient[r] = slope[k] - ratio[r] * slope[q];
        for (int l = 0, c = 0; l <= k; l++) {
            if (l == q)
                continue;
            less[r][c] = h[k][l] - ratio[r] * (l < q ? h[q][l] : h[l][q]) -
                         ratio[c] * (k < q ? h[q][k] : h[k][q]) + ratio[r] * ratio[c] * h[q][q];
            less[r][c] += more * (k == l);
            c++;
        }
        r++;
    }
    solve(m - 1, less, gradient, part);
    way[q] = 0;
    for (int k = 0, r = 0; k < m; k++) {
        if (k == q)
            continue;
        way[k] = part[r];
        way[q] -= ratio[r] * part[r];
        r++;
    }
}

/* Whether a plane normal to the multipliers y excludes a wrench. */
static int beyond(const ca_vectored *p, const ca_real *u, const ca_real *y, ca_real tolerance)
{
    ca_real normal[CA_M];
    const int m = (int)p->axes;
    multipliers(p, y, normal);
    const ca_real demand = ca_dot(m, normal, u), most = height(p, y);
    const ca_real rounding = CA_CHOOSE(1e-14, 1e-5) * (ca_abs(demand) + ca_abs(most));
    return demand - most > tolerance * ca_length(m, normal) + rounding;
}

/* Go by Newton's method from y to the multipliers for u, or for u along a line with e. Returns
 * whether the goal was met; `best` is the iterate that came nearest to it. */
static int newton(const ca_vectored *p, const ca_real *u, const ca_real *e, ca_real tolerance,
                  iterate *best, int *unattainable, int *steps)
{
    const int m = (int)p->axes;
    iterate now;
    evaluate(p, u, e, best);
    for (int step = 0; step < STEPS; step++) {
        ca_real h[CA_M][CA_M], way[CA_M], low = 0, high = -1, length = 1;
        const iterate *from = step ? &now : best;
        if (within(p, from, tolerance, AIM)) {
            if (step)
                *best = now;
            return 1;
        }
        if (step > 3 && !e && beyond(p, u, from->y, tolerance)) {
            *unattainable = 1;
            break;
        }
        ++*steps;
        curvature(p, from->bends, h);
        if (e)
            solve_beside(m, h, e, from->slope,
                         DAMPING * ca_length(m, from->slope) / ca_length(m, from->y), way);
        else
            solve(m, h, from->slope, way);
        const ca_real first = ca_dot(m, from->slope, way), limit = first / 2;
        ca_real y[CA_M];
        ca_copy(m, from->y, y);
        if (!(first > 0))
            break;
        for (int trial = 0; trial < TRIALS; trial++) {
            for (int k = 0; k < m; k++)
                now.y[k] = y[k] + length * way[k];
            evaluate(p, u, e, &now);
            const ca_real slope = ca_dot(m, now.slope, way);
            if (slope > limit)
                low = length;
            else if (slope < -limit)
                high = length;
            else
                break;
            length = high < 0 ? 4 * low : (low + high) / 2;
        }
        if (now.size < best->size)
            *best = now;
    }
    return within(p, best, tolerance, 1);
}

static ca_real size_of(const ca_vectored *p, const ca_real *u)
{
    return ca_max(1, ca_length((int)p->axes, u));
}

void ca_vectored_solve(const ca_vectored *p, const ca_real *u, ca_real *x,
                       ca_vectored_answer *answer)
{
    const int m = (int)p->axes;
    iterate found;
    answer->unattainable = answer->steps = 0;
    for (int k = 0; k < m; k++)
        found.y[k] = ca_dot(m, p->coordinates[k], u) - p->start[k];
    answer->attained = newton(p, u, 0, CA_TOLERANCE * size_of(p, u), &found,
                              &answer->unattainable, &answer->steps);
    answer->unattainable = answer->unattainable && !answer->attained;
    answer->status = answer->attained ? CA_EXACT : CA_INEXACT;
    answer->level = answer->most = 1;
    multipliers(p, found.y, answer->y);
    ca_copy((int)p->components, found.x, x);
}

/* Lower the bound of the end of a line by the plane normal to y, at which the line rises by `rise`. */
static void bound(const ca_vectored *p, const ca_real *begin, const ca_real *y, ca_real rise,
                  ca_vectored_answer *answer)
{
    ca_real normal[CA_M];
    multipliers(p, y, normal);
    const ca_real most = (height(p, y) - ca_dot((int)p->axes, normal, begin)) / rise;
    if (most < answer->most) {
        answer->most = most;
        ca_copy((int)p->axes, normal, answer->y);
    }
}

/* The vectors minimise the cost less a pull times t. While the pull grows, t goes to its greatest
 * value, and the multipliers to the normal there. */
void ca_vectored_line(const ca_vectored *p, const ca_real *begin, const ca_real *way, ca_real end,
                      ca_real *x, ca_vectored_answer *answer)
{
    const int m = (int)p->axes, n = (int)p->components;
    ca_real e[CA_M], u[CA_M], pull = p->greatest, t = 0;
    iterate at;
    int none;
    answer->unattainable = answer->steps = answer->attained = 0;
    answer->most = CA_INFINITY;
    for (int k = 0; k < m; k++)
        e[k] = ca_dot(m, p->coordinates[k], way);
    const ca_real size = ca_length(m, e);
    if (!(size > 0)) {
        ca_vectored_solve(p, begin, x, answer);
        answer->level = answer->most = end;
        return;
    }
    for (int k = 0; k < m; k++) {
        e[k] /= size;
        at.y[k] = pull * e[k];
    }
    for (int trial = 0; trial < PULLS; trial++) {
        const ca_real tolerance = CA_TOLERANCE * ca_max(p->greatest, pull / 1000);
        newton(p, begin, e, tolerance, &at, &none, &answer->steps);
        ca_real left[CA_M], h[CA_M][CA_M], he[CA_M], tangent[CA_M];
        for (int k = 0; k < m; k++)
            left[k] = ca_dot(n, p->matrix[k], at.x) - begin[k];
        t = 0;
        for (int k = 0; k < m; k++)
            t += ca_dot(m, p->coordinates[k], left) * e[k] / size;
        if (t >= end)
            break;
        /* The path of the multipliers goes on along its tangent, which tends to the normal. */
        curvature(p, at.bends, h);
        for (int k = 0; k < m; k++) {
            he[k] = 0;
            for (int l = 0; l < m; l++)
                he[k] -= (l <= k ? h[k][l] : h[l][k]) * e[l];
        }
        solve_beside(m, h, e, he, 0, tangent);
        for (int k = 0; k < m; k++)
            tangent[k] += e[k];
        bound(p, begin, tangent, size, answer);
        bound(p, begin, at.y, size * ca_dot(m, at.y, e), answer);
        if (answer->most - t <= GAP * t || pull >= PULL_MAX * p->greatest)
            break;
        for (int k = 0; k < m; k++)
            at.y[k] += (GROWTH - 1) * pull * tangent[k];
        pull *= GROWTH;
    }
    if (t >= end) {
        for (int k = 0; k < m; k++)
            u[k] = begin[k] + end * way[k];
        answer->attained = newton(p, u, 0, CA_TOLERANCE * size_of(p, u), &at, &none,
                                  &answer->steps);
        multipliers(p, at.y, answer->y);
        t = answer->most = end;
    }
    answer->level = ca_max(t, 0);
    answer->status = CA_SCALED;
    ca_copy(n, at.x, x);
}

/* How far vectors miss a wrench. */
static ca_real missed(const ca_vectored *p, const ca_real *u, const ca_real *x)
{
    ca_real square = 0;
    for (int k = 0; k < (int)p->axes; k++) {
        const ca_real left = u[k] - ca_dot((int)p->components, p->matrix[k], x);
        square += left * left;
    }
    return ca_sqrt(square);
}

/* The least share of its demand that an axis gets, from the reference. */
static ca_real least_share(const ca_vectored *p, const ca_real *u, const ca_real *x)
{
    ca_real least = 1;
    for (int k = 0; k < (int)p->axes; k++) {
        const ca_real served = ca_dot((int)p->components, p->matrix[k], x) - p->reference[k];
        const ca_real way = u[k] - p->reference[k];
        const ca_real share = way > 0 || way < 0 ? served / way : 1;
        least = ca_min(least, ca_clip(share, 0, 1));
    }
    return least;
}

void ca_vectored_allocate(const ca_vectored *p, const ca_real *u, ca_real *x,
                          ca_vectored_answer *answer)
{
    const int m = (int)p->axes, n = (int)p->components, policy = (int)p->policy;
    for (int k = 0; k < m; k++)
        if (!(ca_abs(u[k]) <= CA_ABSURD)) {
            ca_copy(n, p->resting, x);
            answer->status = CA_INVALID;
            answer->steps = answer->attained = answer->unattainable = 0;
            answer->level = answer->most = 0;
            return;
        }
    ca_vectored_solve(p, u, x, answer);
    const ca_real slack = p->slack * size_of(p, u);
    if (answer->attained || (!answer->unattainable && missed(p, u, x) <= slack)) {
        answer->status = CA_EXACT;
        return;
    }
    const int steps = answer->steps, unattainable = answer->unattainable;
    if (!unattainable || policy == CA_SCALED) {
        ca_real way[CA_M];
        for (int k = 0; k < m; k++)
            way[k] = u[k] - p->begin[k];
        ca_vectored_line(p, p->begin, way, 1, x, answer);
        answer->steps += steps;
        answer->unattainable = unattainable;
        if (answer->attained || (!unattainable && missed(p, u, x) <= slack)) {
            answer->status = CA_EXACT;
            answer->level = 1;
            return;
        }
        if (!(p->on_reference > 0))
            answer->level = least_share(p, u, x);
    }
    answer->status = policy;
    if (policy == CA_REJECTED) {
        ca_copy(n, p->resting, x);
        answer->level = 0;
    }
}

/* The angle of the vector (x, y) [rad], with sums and roots alone: the same bits everywhere. */
static ca_real angle_of(ca_real x, ca_real y)
{
    const ca_real length = ca_sqrt(x * x + y * y), front = length + ca_abs(x);
    /* Of half of the angle to the line of x; then of an eighth of it. */
    ca_real tangent = front > 0 ? y / front : 0, sum = 0;
    for (int i = 0; i < 2; i++)
        tangent = tangent / (1 + ca_sqrt(1 + tangent * tangent));
    ca_real power = tangent;
    for (int i = 1; i < 24; i += 2) {
        sum += (i & 2 ? -power : power) / (ca_real)i;
        power *= tangent * tangent;
    }
    const ca_real angle = 8 * sum, half = CA_REAL(3.14159265358979323846);
    return x >= 0 ? angle : (y < 0 ? -half : half) - angle;
}

void ca_vectored_command(const ca_vectored *p, const ca_real *x, const ca_real *shortest,
                         const ca_real *longest, const int *servos, const ca_real *middle,
                         const ca_real *least, const ca_real *greatest, ca_real *lengths,
                         ca_real *angles)
{
    for (int i = 0, s = 0; i < (int)p->sets; x += (int)p->size[i], i++) {
        const int size = (int)p->size[i];
        const ca_real length = size > 1 ? ca_length(size, x) : x[0];
        const int points = size > 1 && length > CA_CHOOSE(1e-12, 1e-6) * ca_max(1, longest[i]);
        lengths[i] = ca_clip(length, shortest[i], longest[i]);
        for (int k = 0; k < servos[i]; k++, s++) {
            ca_real angle = 0;
            if (points && k == 0)
                angle = angle_of(x[0], x[1]);
            else if (points && size == 3)
                angle = angle_of(ca_sqrt(x[0] * x[0] + x[1] * x[1]), x[2]);
            angles[s] = ca_clip(middle[s] + angle, least[s], greatest[s]);
        }
    }
}

/* Projection on convex sets, the dual Newton method with it, and lines to the boundary. */
#include "vectored_newton.h"
#include "numbers.h"

#define AXES CA_VECTORED_AXES
#define COMPONENTS CA_VECTORED_COMPONENTS
#define STEPS 60    /* of Newton's method */
#define TRIALS 60   /* of one search along a line */
#define PULLS 20    /* along one line to the boundary */
#define AIM CA_REAL(0.5)                /* share of the tolerance that Newton's method aims at */
#define SUM CA_CHOOSE(4 * 2.2e-16, 4 * 1.2e-7) /* rounding error of a sum, as a share of its terms */
#define ROUNDING CA_CHOOSE(1e-12, 1e-5) /* of the dual, as a share of it */
#define FLAT CA_CHOOSE(1e-9, 1e-5)      /* curvature that counts as none, relative to the greatest */
#define SHORT CA_CHOOSE(1e-6, 1e-3)     /* slope, as a share of y, whose sum loses digits */
#define DAMPING CA_REAL(0.01) /* of steps for a line, so that they are not much longer than y */
#define GROWTH 4 /* of the pull */
#define GAP CA_CHOOSE(5e-10, 1e-4)      /* by which a line may be too short, as a share of it */
#define HALVINGS 40 /* of the rest of a line */
#define PULL_MAX CA_CHOOSE(1e7, 1e3)    /* greatest weight of the length of a line */
#define DISTANT CA_CHOOSE(1e140, 1e16) /* components, whose squares are finite */
#define FAR CA_CHOOSE(1e20, 1e10) /* multipliers, in units of the greatest deviation, that say no more */

/* What the derivative of a projection lacks to the identity: a sum of stiff * d d^T over directions
 * d in the half plane of the components along and across the axis, and around the axis. */
typedef struct {
    int first, size;  /* components of the set */
    ca_real to[2];    /* the first direction; the second one is normal to it */
    ca_real stiff[3]; /* of the first, of the second, and around */
    ca_real away[2];  /* the direction across */
} bend;

typedef struct {
    ca_real y[CA_M];     /* multipliers of the basis */
    ca_real x[CA_N];
    ca_real slope[CA_M]; /* of the dual: what is missing of the wrench, by the basis */
    ca_real along;       /* of a line: what the slope lacks along it */
    ca_real size;        /* length of the slope */
    ca_real missed;      /* what is missing [N, N m], of a line the size; infinite: a lot */
    int moved;           /* number of vectors that the projection has moved */
    bend bends[CA_N];    /* of these */
} iterate;

/* What Newton's method goes to: a wrench, or with e, a unit vector, one on the line along it. */
typedef struct {
    const ca_real *u, *e;
    ca_real y[CA_M];   /* multipliers of u if no vector has to be projected */
    ca_real tolerance;
    ca_real near;      /* with a greater slope the wrench is not met */
} goal;

/* The point (to, up) of the flank or of the plane at `least` that is nearest to (a, c). */
static void beside_arc(const ca_vectored *p, int i, ca_real a, ca_real c, ca_real *to, ca_real *up,
                       bend *b)
{
    b->to[0] = b->stiff[0] = b->stiff[1] = 1;
    b->to[1] = 0;
    /* Distances would not tell the two apart far away. */
    if (c <= p->inner[i]) {
        *to = p->least[i];
        *up = c;
        if (c < p->inner[i])
            b->stiff[1] = 0;
        return;
    }
    if (!(p->flank[i] < p->radius[i])) {
        *to = p->end_along[i];
        *up = p->end_across[i];
        return;
    }
    const ca_real on = a * p->cosine[i] + c * p->sine[i];
    const ca_real held = ca_clip(on, p->flank[i], p->radius[i]);
    *to = held * p->cosine[i];
    *up = held * p->sine[i];
    if (held >= on && held <= on) {
        b->to[0] = -p->sine[i];
        b->to[1] = p->cosine[i];
        b->stiff[1] = 0;
    }
}

/* Project a vector on set i, of which it is outside; b has its first component and its size. */
static void project(const ca_vectored *p, int i, const ca_real *v, ca_real across, ca_real square,
                    ca_real *x, bend *b)
{
    const ca_real r = p->radius[i], a = v[0], c = across;
    ca_real to, up;
    if (b->size == 1) {
        *x = ca_clip(a, p->least[i], r);
        return;
    }
    if (square > r * r && (p->full[i] > 0 || c * p->end_along[i] <= a * p->end_across[i])) {
        const ca_real length = ca_sqrt(square), shrink = r / length;
        to = a * shrink;
        up = c * shrink;
        b->to[0] = a / length;
        b->to[1] = c / length;
        b->stiff[0] = 1;
        b->stiff[1] = 1 - shrink;
    } else {
        beside_arc(p, i, a, c, &to, &up, b);
    }
    x[0] = to;
    if (b->size == 2) {
        b->away[0] = v[1] < 0 ? -1 : 1;
        x[1] = v[1] < 0 ? -up : up;
        return;
    }
    const ca_real ratio = c > 0 ? up / c : 0;
    b->away[0] = c > 0 ? v[1] / c : 1;
    b->away[1] = c > 0 ? v[2] / c : 0;
    b->stiff[2] = c > 0 ? 1 - ratio
                        : b->stiff[0] * b->to[1] * b->to[1] + b->stiff[1] * b->to[0] * b->to[0];
    x[1] = ratio * v[1];
    x[2] = ratio * v[2];
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
    const int m = AXES(p);
    for (int k = 0; k < m; k++)
        normal[k] = y[0] * p->coordinates[0][k];
    for (int l = 1; l < m; l++)
        for (int k = 0; k < m; k++)
            normal[k] += y[l] * p->coordinates[l][k];
}

/* Greatest product of an attainable wrench and the wrench multipliers of y. */
static ca_real height(const ca_vectored *p, const ca_real *y)
{
    const int m = AXES(p);
    ca_real sum = 0, slopes[3];
    for (int i = 0, j = 0; i < (int)p->sets; i++) {
        const int size = (int)p->size[i];
        for (int k = 0; k < size; k++, j++)
            slopes[k] = p->weight[j] * ca_dot(m, p->basis[j], y);
        sum += support(p, i, size, slopes);
    }
    return sum;
}

/* Set what belongs to at->y. */
static void evaluate(const ca_vectored *p, const goal *g, iterate *at)
{
    const int m = AXES(p), n = COMPONENTS(p), sets = (int)p->sets;
    ca_real left[CA_M];
    for (int k = 0; k < m; k++)
        at->slope[k] = g->y[k] - at->y[k];
    for (int j = 0; j < n; j++)
        at->x[j] = p->preferred[j] + ca_dot(m, p->rates[j], at->y);
    at->moved = 0;
    /* The vectors inside their sets produce y; the others differ by what the projection moves. */
    for (int i = 0, j = 0, size; i < sets; i++, j += size) {
        ca_real *x = at->x + j, v[3], c = 0, square, longest;
        bend *b = &at->bends[at->moved];
        size = (int)p->size[i];
        v[0] = x[0];
        v[1] = size > 1 ? x[1] : 0;
        v[2] = size > 2 ? x[2] : 0;
        /* Of vectors so far away the direction decides, and squares would overflow. */
        longest = ca_max(ca_abs(v[0]), ca_max(ca_abs(v[1]), ca_abs(v[2])));
        for (int l = 0; longest > DISTANT && size > 1 && l < size; l++)
            x[l] *= DISTANT / longest;
        square = x[0] * x[0];
        if (size == 1) {
            if (x[0] > p->least[i] && x[0] < p->radius[i])
                continue;
        } else {
            c = size == 2 ? ca_abs(x[1]) : ca_sqrt(x[1] * x[1] + x[2] * x[2]);
            square += c * c;
            if (square <= p->radius[i] * p->radius[i] &&
                (p->full[i] > 0 ||
                 (c * p->cosine[i] <= x[0] * p->sine[i] && x[0] >= p->least[i])))
                continue;
        }
        const ca_real near[3] = {x[0], size > 1 ? x[1] : 0, size > 2 ? x[2] : 0};
        b->size = size;
        project(p, i, near, c, square, x, b);
        b->first = j;
        at->moved++;
        for (int l = 0; l < size; l++) {
            const ca_real moved = p->weight[j] * (x[l] - v[l]);
            for (int k = 0; k < m; k++)
                at->slope[k] -= moved * p->basis[j + l][k];
        }
    }
    at->size = ca_length(m, at->slope);
    at->missed = CA_UNBOUNDED;
    if (at->size > g->near + SHORT * ca_length(m, at->y))
        return;
    for (int k = 0; k < m; k++)
        left[k] = g->u[k] - ca_dot(n, p->matrix[k], at->x);
    for (int k = 0; k < m; k++)
        at->slope[k] = ca_dot(m, p->coordinates[k], left);
    if (g->e) {
        at->along = ca_dot(m, at->slope, g->e);
        for (int k = 0; k < m; k++)
            at->slope[k] -= at->along * g->e[k];
    }
    at->size = ca_length(m, at->slope);
    at->missed = g->e ? at->size : ca_length(m, left);
}

/* Whether what is missing is within a share of the tolerance or of the rounding error of B x. */
static int within(const ca_vectored *p, const iterate *at, ca_real tolerance, ca_real share)
{
    ca_real square = 0;
    if (at->missed <= share * tolerance)
        return 1;
    if (!(at->missed < CA_UNBOUNDED))
        return 0;
    for (int k = 0; k < AXES(p); k++) {
        ca_real sum = 0;
        for (int j = 0; j < COMPONENTS(p); j++)
            sum += ca_abs(p->matrix[k][j] * at->x[j]);
        square += sum * sum;
    }
    return at->missed <= share * SUM * ca_sqrt(square);
}

/* Deduct stiff * v v^T. */
static void deduct(int m, ca_real h[CA_M][CA_M], ca_real stiff, const ca_real *v)
{
    for (int k = 0; k < m; k++)
        for (int l = 0; l <= k; l++)
            h[k][l] -= stiff * v[k] * v[l];
}

/* h = basis^T D basis, with the derivative D of the projection: the identity, less a term for each
 * vector that the projection has moved. */
static void curvature(const ca_vectored *p, const iterate *at, ca_real h[CA_M][CA_M])
{
    const int m = AXES(p);
    for (int k = 0; k < m; k++)
        for (int l = 0; l <= k; l++)
            h[k][l] = k == l;
    for (const bend *b = at->bends; b < at->bends + at->moved; b++) {
        const ca_real *along = p->basis[b->first];
        ca_real across[CA_M], v[CA_M];
        if (b->size == 1) {
            deduct(m, h, 1, along);
            continue;
        }
        const ca_real *one = p->basis[b->first + 1], *two = one + (b->size == 3) * CA_M;
        for (int k = 0; k < m; k++)
            across[k] = b->away[0] * one[k] + (b->size == 3 ? b->away[1] * two[k] : 0);
        for (int k = 0; k < m; k++)
            v[k] = b->to[0] * along[k] + b->to[1] * across[k];
        deduct(m, h, b->stiff[0], v);
        for (int k = 0; k < m; k++)
            v[k] = b->to[0] * across[k] - b->to[1] * along[k];
        if (b->stiff[1] > 0)
            deduct(m, h, b->stiff[1], v);
        for (int k = 0; b->size == 3 && k < m; k++)
            v[k] = b->away[0] * two[k] - b->away[1] * one[k];
        if (b->size == 3 && b->stiff[2] > 0)
            deduct(m, h, b->stiff[2], v);
    }
}

/* Solve h way = slope; small pivots are raised, or the way does not go where they are. */
static void solve(int m, ca_real h[CA_M][CA_M], const ca_real *slope, int raised, ca_real *way)
{
    ca_real most = 0;
    for (int k = 0; k < m; k++)
        most = ca_max(most, h[k][k]);
    const ca_real floor = FLAT * ca_max(most, FLAT);
    /* h = L D L^T: D goes to the diagonal of h, and L below it. */
    for (int k = 0; k < m; k++) {
        way[k] = slope[k];
        for (int l = 0; l < k; l++)
            for (int j = 0; j < l; j++)
                h[k][l] -= h[k][j] * h[l][j];
        for (int l = 0; l < k; l++) {
            const ca_real scaled = h[k][l];
            h[k][l] = scaled / h[l][l];
            h[k][k] -= h[k][l] * scaled;
            way[k] -= h[k][l] * way[l];
        }
        if (!raised && h[k][k] < floor)
            way[k] = 0;
        h[k][k] = ca_max(h[k][k], floor);
    }
    for (int k = m - 1; k >= 0; k--) {
        way[k] /= h[k][k];
        for (int l = k + 1; l < m; l++)
            way[k] -= h[l][k] * way[l];
    }
}

/* The same for a way normal to e, a unit vector; with `more` curvature small pivots are raised. */
static void solve_beside(int m, ca_real h[CA_M][CA_M], const ca_real *e, const ca_real *slope,
                         ca_real more, ca_real *way)
{
    int q = 0;
    ca_real ratio[CA_M], less[CA_M][CA_M] = {{0}}, gradient[CA_M] = {0}, part[CA_M];
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
    solve(m - 1, less, gradient, more > 0, part);
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
    const int m = AXES(p);
    multipliers(p, y, normal);
    const ca_real demand = ca_dot(m, normal, u), most = height(p, y);
    const ca_real rounding = CA_CHOOSE(1e-14, 1e-5) * (ca_abs(demand) + ca_abs(most));
    return demand - most > tolerance * ca_length(m, normal) + rounding;
}

/* The dual at an iterate, whose greatest value Newton's method looks for. */
static ca_real dual(const ca_vectored *p, const goal *g, const iterate *at)
{
    const int m = AXES(p), n = COMPONENTS(p);
    ca_real sum = ca_dot(m, at->y, at->slope);
    if (g->e)
        sum += at->along * ca_dot(m, at->y, g->e);
    for (int j = 0; j < n; j++) {
        const ca_real own = p->weight[j] * (at->x[j] - p->preferred[j]);
        sum += own * own / 2;
    }
    return sum;
}

/* Go by Newton's method from the multipliers of pair[0]. Returns the iterate that came nearest. */
static const iterate *newton(const ca_vectored *p, const goal *g, iterate pair[2],
                             ca_vectored_answer *answer)
{
    const int m = AXES(p);
    iterate *best = &pair[0], *now = best, *spare = &pair[1];
    ca_real last = CA_UNBOUNDED;
    evaluate(p, g, best);
    answer->attained = 1;
    for (int step = 0; step < STEPS; step++) {
        ca_real h[CA_M][CA_M], way[CA_M], y[CA_M], low = 0, high = -1, length;
        if (within(p, now, g->tolerance, AIM))
            return now;
        if (step > 3 && !g->e && now->size > last / 2 && beyond(p, g->u, now->y, g->tolerance)) {
            answer->unattainable = 1;
            break;
        }
        last = now->size;
        answer->steps++;
        curvature(p, now, h);
        if (g->e)
            solve_beside(m, h, g->e, now->slope,
                         DAMPING * ca_length(m, now->slope) / ca_length(m, now->y), way);
        else
            solve(m, h, now->slope, 1, way);
        const ca_real first = ca_dot(m, now->slope, way), limit = first / 2;
        const ca_real far = FAR * p->greatest, size = ca_length(m, way);
        const ca_real least = dual(p, g, now), slack = ROUNDING * ca_abs(least);
        ca_copy(m, now->y, y);
        if (!(first > 0))
            break;
        length = size > far ? far / size : 1;
        now = now == best ? spare : now;
        for (int trial = 0; trial < TRIALS; trial++) {
            for (int k = 0; k < m; k++)
                now->y[k] = y[k] + length * way[k];
            evaluate(p, g, now);
            const ca_real slope = ca_dot(m, now->slope, way);
            if (slope > limit) {
                low = length;
                /* The squares of still longer vectors would overflow. */
                if (ca_length(m, now->y) > far)
                    break;
            } else if (slope < -limit || (slope < 0 && dual(p, g, now) < least - slack))
                high = length; /* too far: the slope may fall below 0 at once, and stay there */
            else
                break;
            length = high < 0 ? 4 * low : low > 0 ? (low + high) / 2 : high / 8;
        }
        if (now->size < best->size) {
            spare = best;
            best = now;
        }
        if (ca_length(m, now->y) > far) {
            answer->unattainable = !g->e && beyond(p, g->u, now->y, g->tolerance);
            break;
        }
    }
    answer->attained = within(p, best, g->tolerance, 1);
    return best;
}

static ca_real size_of(const ca_vectored *p, const ca_real *u)
{
    return ca_max(1, ca_length(AXES(p), u));
}

static void aim_at(const ca_vectored *p, const ca_real *u, goal *g)
{
    g->u = u;
    g->e = 0;
    for (int k = 0; k < AXES(p); k++)
        g->y[k] = ca_dot(AXES(p), p->coordinates[k], u) - p->start[k];
    g->tolerance = CA_EXACT_TOLERANCE * size_of(p, u);
    g->near = p->span * ca_max(g->tolerance, SUM * p->terms);
}

void ca_vectored_solve(const ca_vectored *p, const ca_real *u, ca_real *x,
                       ca_vectored_answer *answer)
{
    iterate pair[2];
    goal g;
    answer->unattainable = answer->steps = 0;
    aim_at(p, u, &g);
    ca_copy(AXES(p), g.y, pair[0].y);
    const iterate *found = newton(p, &g, pair, answer);
    answer->unattainable = answer->unattainable && !answer->attained;
    answer->status = answer->attained ? CA_EXACT : CA_INEXACT;
    answer->level = answer->most = 1;
    multipliers(p, found->y, answer->y);
    ca_copy(COMPONENTS(p), found->x, x);
}

/* Lower the bound of the end of a line by the plane normal to y, at which the line rises by `rise`. */
static void bound(const ca_vectored *p, const ca_real *begin, const ca_real *y, ca_real rise,
                  ca_vectored_answer *answer)
{
    ca_real normal[CA_M];
    multipliers(p, y, normal);
    const ca_real most = (height(p, y) - ca_dot(AXES(p), normal, begin)) / rise;
    if (most < answer->most) {
        answer->most = most;
        ca_copy(AXES(p), normal, answer->y);
    }
}

/* Whether vectors produce the wrench of a line at a length of it. */
static int is_near(const ca_vectored *p, const ca_real *begin, const ca_real *way, ca_real t,
                   const ca_real *x)
{
    const int m = AXES(p);
    ca_real left[CA_M];
    for (int k = 0; k < m; k++)
        left[k] = ca_dot(COMPONENTS(p), p->matrix[k], x) - begin[k] - t * way[k];
    return ca_length(m, left) <= GAP * t * ca_length(m, way);
}

/* The length of a line whose end the pulls have lost: x are the vectors at `low`, which is negative if
 * there are none, and `high` is beyond the end. */
static ca_real halve(const ca_vectored *p, const ca_real *begin, const ca_real *way, ca_real low,
                     ca_real high, iterate pair[2], ca_real *x, ca_vectored_answer *answer)
{
    ca_real u[CA_M];
    goal g;
    for (int i = 0; i < HALVINGS && high - low > GAP * high; i++) {
        const ca_real t = low < 0 ? 0 : (low + high) / 2;
        for (int k = 0; k < AXES(p); k++)
            u[k] = begin[k] + t * way[k];
        aim_at(p, u, &g);
        ca_copy(AXES(p), g.y, pair[0].y);
        const iterate *at = newton(p, &g, pair, answer);
        if (answer->attained || low < 0) {
            low = t;
            ca_copy(COMPONENTS(p), at->x, x);
        } else {
            high = t;
        }
    }
    return low;
}

/* The vectors minimise the cost less a pull times t. While the pull grows, t goes to its greatest
 * value, and the multipliers to the normal there. */
void ca_vectored_line(const ca_vectored *p, const ca_real *begin, const ca_real *way, ca_real end,
                      ca_real *x, ca_vectored_answer *answer)
{
    const int m = AXES(p), n = COMPONENTS(p);
    ca_real e[CA_M], u[CA_M], pull = p->greatest, t = 0, reached = -1;
    int met = 0;
    iterate pair[2];
    const iterate *at = pair;
    goal g;
    answer->unattainable = answer->steps = answer->attained = 0;
    answer->most = CA_UNBOUNDED;
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
        pair[0].y[k] = pull * e[k];
    }
    aim_at(p, begin, &g);
    g.e = e;
    g.near = CA_UNBOUNDED;
    for (int trial = 0; trial < PULLS; trial++) {
        g.tolerance = CA_EXACT_TOLERANCE * ca_max(p->greatest, pull / 1000);
        at = newton(p, &g, pair, answer);
        ca_real left[CA_M], h[CA_M][CA_M], near[CA_M], turn[CA_M], tangent[CA_M];
        for (int k = 0; k < m; k++)
            left[k] = ca_dot(n, p->matrix[k], at->x) - begin[k];
        t = 0;
        for (int k = 0; k < m; k++)
            t += ca_dot(m, p->coordinates[k], left) * e[k] / size;
        if (t >= end)
            break;
        met = answer->attained;
        if (met) {
            reached = t;
            ca_copy(n, at->x, x);
        }
        /* The path of the multipliers goes on along its tangent, which tends to the normal. At a
         * corner there are many: by turns the one nearest to the multipliers, or to the way. */
        curvature(p, at, h);
        const ca_real along = ca_dot(m, at->y, e);
        for (int k = 0; k < m; k++)
            near[k] = trial % 2 ? e[k] : at->y[k] / along;
        for (int k = 0; k < m; k++) {
            turn[k] = 0;
            for (int l = 0; l < m; l++)
                turn[k] -= (l <= k ? h[k][l] : h[l][k]) * near[l];
        }
        solve_beside(m, h, e, turn, 0, tangent);
        for (int k = 0; k < m; k++)
            tangent[k] += near[k];
        bound(p, begin, tangent, size, answer);
        bound(p, begin, at->y, size * along, answer);
        if (answer->most - t <= GAP * t || pull >= PULL_MAX * p->greatest)
            break;
        for (int k = 0; k < m; k++)
            pair[0].y[k] = at->y[k] + (GROWTH - 1) * pull * tangent[k];
        pull *= GROWTH;
    }
    if (t >= end) {
        ca_real y[CA_M];
        ca_copy(m, at->y, y);
        for (int k = 0; k < m; k++)
            u[k] = begin[k] + end * way[k];
        aim_at(p, u, &g);
        ca_copy(m, y, pair[0].y);
        at = newton(p, &g, pair, answer);
        met = answer->attained || is_near(p, begin, way, end, at->x);
        if (met) {
            multipliers(p, at->y, answer->y);
            t = answer->most = end;
        } else {
            bound(p, begin, y, size * ca_dot(m, y, e), answer);
        }
    } else {
        answer->attained = 0;
        met = met || is_near(p, begin, way, t, at->x);
    }
    if (met) {
        ca_copy(n, at->x, x);
    } else {
        t = halve(p, begin, way, reached, ca_min(end, answer->most), pair, x, answer);
        answer->attained = 0;
    }
    answer->level = ca_max(t, 0);
    answer->status = CA_SCALED;
}

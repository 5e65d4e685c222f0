/* Priorities of vectors in convex sets: which wrench to serve if the demand is not attainable.
 *
 * Each step goes along a line to the boundary of the attainable set, while the axes of the steps
 * before it are kept at a value or in a range. Where it ends on the boundary, only the vectors with
 * the greatest product with the normal serve as much: a face of the sets. The next steps stay on it.
 */
#include "vectored_priorities.h"
#include "numbers.h"
#include "vectored_newton.h"

#include <string.h>

/* Change of a linear function along a face that counts as none, as a share of its range. */
#define LEVEL CA_CHOOSE(1e-8, 1e-4)
/* Share of a row that others do not give, below which they give it. */
#define DEPENDENT CA_CHOOSE(1e-6, 1e-3)
/* Distance to a goal, as a share of an axis's range, that counts as none. */
#define STILL CA_CHOOSE(1e-12, 1e-6)
/* Distance from the demand, as a share of an axis's range, that counts as served. */
#define PRIORITY_TOLERANCE CA_CHOOSE(1e-7, 1e-4)
/* Change of a more important axis, as a share of its range, for which a step is left out. */
#define MOVED CA_CHOOSE(1e-6, 1e-3)
/* Least weight of an axis in its group, as a share of its range, and relative to the greatest. */
#define LAG CA_REAL(1e-3)
#define LAG_RATIO CA_REAL(1e-6)

/* Axes that are implied follow from the face and the axes that are kept. */
enum { FREE, KEPT, IMPLIED };

typedef struct {
    ca_real x[CA_N];
    /* What is left of the set of each effector: base + ways z, with `count` components z. They are
     * in the whole set, or in an interval or a disc whose ends are `low` and `high`. */
    int whole[CA_N], count[CA_N];
    ca_real base[CA_N], ways[CA_N][3], low[CA_N], high[CA_N];
    int state[CA_M];
    ca_real least[CA_M], most[CA_M];
    int steps;
} run;

static ca_real wrench(const ca_vectored *p, const run *r, int axis)
{
    return ca_dot((int)p->components, p->matrix[axis], r->x);
}

/* Split the rows of q into an orthonormal basis and coordinates, without rows that others give. */
static int split(int rows, ca_vectored *q, int *use)
{
    const int n = (int)q->components;
    int used = 0;
    for (int i = 0; i < rows; i++) {
        ca_real rest[CA_N], part[CA_M] = {0}, sum = 0, size = 0;
        for (int j = 0; j < n; j++) {
            rest[j] = q->matrix[i][j] / q->weight[j];
            sum += rest[j] * rest[j];
        }
        for (int pass = 0; pass < 2; pass++)
            for (int l = 0; l < used; l++) {
                ca_real along = 0;
                for (int j = 0; j < n; j++)
                    along += q->basis[j][l] * rest[j];
                for (int j = 0; j < n; j++)
                    rest[j] -= along * q->basis[j][l];
                part[l] += along;
            }
        size = ca_length(n, rest);
        if (!(size > DEPENDENT * ca_sqrt(sum)) || used == CA_M)
            continue;
        for (int j = 0; j < n; j++) {
            q->basis[j][used] = rest[j] / size;
            q->rates[j][used] = q->basis[j][used] / q->weight[j];
        }
        for (int k = 0; k < CA_M; k++)
            q->coordinates[used][k] = 0;
        for (int l = 0; l < used; l++)
            for (int k = 0; k <= l; k++)
                q->coordinates[used][k] -= part[l] * q->coordinates[l][k] / size;
        q->coordinates[used][used] = 1 / size;
        ca_copy(n, q->matrix[i], q->matrix[used]);
        use[used++] = i;
    }
    q->axes = (ca_real)used;
    q->span = q->terms = 0;
    for (int l = 0; l < used; l++) {
        ca_real sum = 0;
        for (int i = 0, j = 0; i < (int)q->sets; j += (int)q->size[i], i++)
            for (int k = j; k < j + (int)q->size[i]; k++)
                sum += ca_abs(q->matrix[l][k]) * ca_max(ca_abs(q->least[i]), ca_abs(q->radius[i]));
        q->terms += sum * sum;
        q->span += ca_dot(l + 1, q->coordinates[l], q->coordinates[l]);
    }
    /* The length of all coordinates is at least that of a unit vector. */
    q->span = ca_sqrt(q->span);
    q->terms = ca_sqrt(q->terms);
    for (int k = 0; k < used; k++) {
        ca_real wrenches[CA_M];
        for (int l = 0; l <= k; l++)
            wrenches[l] = ca_dot(n, q->matrix[l], q->preferred);
        q->start[k] = ca_dot(k + 1, q->coordinates[k], wrenches);
    }
    return used;
}

/* Prepare the problem of what is left for some axes; an axis with low < high may be so far from its
 * goal. `use` are the numbers of the axes that are independent; returns how many there are. */
static int prepare(const ca_vectored *p, const run *r, int rows, const int *axes,
                   const ca_real *low, const ca_real *high, ca_vectored *q, int *use)
{
    int n = 0, s = 0;
    q->greatest = 0;
    for (int i = 0, j = 0; i < (int)p->sets; j += (int)p->size[i], i++) {
        const int size = (int)p->size[i], count = r->count[i];
        if (!count)
            continue;
        const int whole = r->whole[i];
        q->size[s] = (ca_real)count;
        q->least[s] = whole ? p->least[i] : count > 1 ? 0 : r->low[i];
        q->radius[s] = whole ? p->radius[i] : r->high[i];
        q->full[s] = whole ? p->full[i] : 1;
        q->cosine[s] = p->cosine[i];
        q->sine[s] = p->sine[i];
        q->flank[s] = p->flank[i];
        q->end_along[s] = p->end_along[i];
        q->end_across[s] = p->end_across[i];
        q->inner[s] = p->inner[i];
        for (int c = 0; c < count; c++, n++) {
            q->weight[n] = p->weight[j];
            q->preferred[n] = 0;
            for (int k = 0; k < size; k++)
                q->preferred[n] += r->ways[j + k][c] * (p->preferred[j + k] - r->base[j + k]);
            for (int l = 0; l < rows; l++) {
                q->matrix[l][n] = 0;
                for (int k = 0; k < size; k++)
                    q->matrix[l][n] += p->matrix[axes[l]][j + k] * r->ways[j + k][c];
            }
            const ca_real end = ca_max(ca_abs(q->least[s]), ca_abs(q->radius[s]));
            q->greatest = ca_max(q->greatest, q->weight[n] * (end + ca_abs(q->preferred[n])));
        }
        s++;
    }
    for (int l = 0; l < rows; l++) {
        if (!(low[axes[l]] < high[axes[l]]))
            continue;
        /* The way within the range is one more number, as great as the other ones. */
        const ca_real unit = p->extent[axes[l]] / p->greatest;
        for (int k = 0; k < rows; k++)
            q->matrix[k][n] = k == l ? -unit : 0;
        q->size[s] = q->weight[n] = 1;
        q->preferred[n] = 0;
        q->least[s] = low[axes[l]] / unit;
        q->radius[s] = high[axes[l]] / unit;
        q->greatest = ca_max(q->greatest, ca_max(ca_abs(q->least[s]), ca_abs(q->radius[s])));
        n++;
        s++;
    }
    q->sets = (ca_real)s;
    q->components = (ca_real)n;
    return split(rows, q, use);
}

/* Take the vectors of what is left. */
static void take(const ca_vectored *p, run *r, const ca_real *z)
{
    for (int i = 0, j = 0; i < (int)p->sets; z += r->count[i], j += (int)p->size[i], i++)
        for (int k = j; k < j + (int)p->size[i]; k++)
            r->x[k] = r->base[k] + ca_dot(r->count[i], r->ways[k], z);
}

/* Keep of set i, whose components begin at j, the vectors with the greatest product with a slope. */
static void face(const ca_vectored *p, run *r, int i, int j, const ca_real *slope)
{
    const int size = (int)p->size[i], count = r->count[i];
    const ca_real radius = p->radius[i];
    ca_real rate[3] = {0}, across = 0, away[2] = {1, 0}, out = 0, side = 0, turned = 0;
    for (int c = 0; c < count; c++)
        for (int k = 0; k < size; k++)
            rate[c] += slope[k] * r->ways[j + k][c];
    const ca_real width = !r->whole[i] ? r->high[i] - r->low[i]
                          : size > 1 ? radius : radius - p->least[i];
    if (ca_length(count, rate) * width <= LEVEL)
        return;
    const int sector = r->whole[i] && size > 1 && !(p->full[i] > 0);
    r->whole[i] = r->count[i] = 0;
    if (sector) {
        across = ca_length(size - 1, r->x + j + 1);
        for (int k = 1; k < size; k++) {
            away[k - 1] = across > 0 ? r->x[j + k] / across : away[k - 1];
            out += rate[k] * away[k - 1];
            side += rate[k] * rate[k];
        }
        for (int k = 1; k < size; k++)
            turned += (rate[k] - out * away[k - 1]) * (rate[k] - out * away[k - 1]);
        const ca_real along = rate[0] * p->cosine[i] + out * p->sine[i];
        const ca_real end = p->least[i] > 0 ? p->inner[i] : p->cosine[i] > 0 ? 0 : radius;
        if (p->cosine[i] > 0 && p->flank[i] < radius && out > 0 &&
            radius * ca_sqrt(along * along + turned) <= LEVEL) {
            r->count[i] = 1;
            r->low[i] = p->flank[i];
            r->high[i] = radius;
            for (int k = 0; k < size; k++) {
                r->base[j + k] = 0;
                r->ways[j + k][0] = k ? p->sine[i] * away[k - 1] : p->cosine[i];
            }
            return;
        }
        if (rate[0] < 0 && end > 0 && ca_sqrt(side) * radius <= LEVEL) {
            r->count[i] = size - 1;
            r->low[i] = -end;
            r->high[i] = end;
            for (int k = 0; k < size; k++) {
                r->base[j + k] = k ? 0 : p->least[i];
                for (int c = 0; c < size - 1; c++)
                    r->ways[j + k][c] = (ca_real)(k == c + 1);
            }
            return;
        }
    }
    ca_copy(size, r->x + j, r->base + j);
}

static void keep(run *r, int axis, ca_real least, ca_real most)
{
    r->least[axis] = least;
    r->most[axis] = most;
    r->state[axis] = KEPT;
}

/* The axes that are kept, those at a value first, and behind them `count` others. */
static int listed(const ca_vectored *p, const run *r, int count, const int *others, int *axes)
{
    const int m = (int)p->axes;
    int rows = 0;
    for (int wide = 0; wide < 2; wide++)
        for (int k = 0; k < m; k++) {
            int other = 0;
            for (int i = 0; i < count; i++)
                other = other || others[i] == k;
            if (!other && r->state[k] == KEPT && (r->least[k] < r->most[k]) == wide)
                axes[rows++] = k;
        }
    for (int i = 0; i < count; i++)
        axes[rows++] = others[i];
    return rows;
}

/* Move `count` axes along begin + t way as far as possible, at most to t = end; returns t. An axis
 * may be ahead of the line by its part of `ahead` ways. */
static ca_real go(const ca_vectored *p, run *r, int count, const int *others, const ca_real *begin,
                  const ca_real *way, ca_real end, ca_real ahead)
{
    const int m = (int)p->axes, n = (int)p->components;
    ca_real goals[CA_M] = {0}, ways[CA_M] = {0}, low[CA_M], high[CA_M];
    ca_real u[CA_M], line[CA_M], z[CA_N], normal[CA_M] = {0}, rise = 0, longest = 0;
    int axes[CA_M], use[CA_M], found = 0;
    ca_vectored q;
    ca_vectored_answer answer;
    ca_copy(m, r->least, low);
    ca_copy(m, r->most, high);
    for (int i = 0; i < count; i++) {
        const int k = others[i];
        goals[k] = begin[i];
        ways[k] = way[i];
        low[k] = ca_min(ahead * way[i], 0);
        high[k] = ca_max(ahead * way[i], 0);
    }
    const int rows = listed(p, r, count, others, axes);
    const int used = prepare(p, r, rows, axes, low, high, &q, use);
    for (int i = 0; i < used; i++)
        found += use[i] >= rows - count;
    if (found < count) {
        /* What cannot move follows from the others. */
        for (int i = 0; i < count; i++)
            r->state[others[i]] = IMPLIED;
        return 0;
    }
    for (int i = 0; i < used; i++) {
        const int k = axes[use[i]];
        u[i] = goals[k] - ca_dot(n, p->matrix[k], r->base);
        if (use[i] < rows - count && !(low[k] < high[k]))
            u[i] += low[k];
        line[i] = ways[k];
    }
    ca_vectored_line(&q, u, line, end, z, &answer);
    r->steps += answer.steps;
    take(p, r, z);
    if (answer.level >= end)
        return end;
    for (int i = 0; i < used; i++)
        normal[axes[use[i]]] = answer.y[i];
    for (int i = 0; i < count; i++) {
        rise += normal[others[i]] * way[i];
        longest = ca_max(longest, ca_abs(way[i]) / p->extent[others[i]]);
    }
    /* Of nearly dependent axes the normal may be lost. */
    for (int k = 0; k < m; k++)
        normal[k] *= rise > 0 ? longest / rise : 0;
    for (int i = 0; i < count; i++) {
        const ca_real at = begin[i] + answer.level * way[i];
        const ca_real far = ahead > 0 ? begin[i] + end * way[i] : at;
        keep(r, others[i], ca_min(at, far), ca_max(at, far));
    }
    for (int i = 0; i < used; i++) {
        const int k = axes[use[i]];
        if (r->least[k] < r->most[k] && ca_abs(normal[k]) * (high[k] - low[k]) > LEVEL)
            r->least[k] = r->most[k] = wrench(p, r, k);
    }
    if (!(rise > 0))
        return answer.level;
    for (int i = 0, j = 0; i < (int)p->sets; j += (int)p->size[i], i++) {
        ca_real slope[3] = {0};
        for (int c = 0; c < (int)p->size[i]; c++)
            for (int k = 0; k < m; k++)
                slope[c] += normal[k] * p->matrix[k][j + c];
        face(p, r, i, j, slope);
    }
    int last = others[0];
    for (int i = 1; i < count; i++)
        if (ca_abs(normal[others[i]]) * p->extent[others[i]] > ca_abs(normal[last]) * p->extent[last])
            last = others[i];
    r->state[last] = IMPLIED;
    return answer.level;
}

/* Bring an axis into a range, or as near to it as possible, and keep it there. */
static void bring(const ca_vectored *p, run *r, int axis, ca_real low, ca_real high)
{
    const ca_real at = wrench(p, r, axis), extent = p->extent[axis];
    if (r->state[axis] == IMPLIED)
        return;
    if (r->state[axis] == KEPT) {
        low = ca_clip(low, r->least[axis], r->most[axis]);
        high = ca_clip(high, r->least[axis], r->most[axis]);
    }
    const ca_real goal = ca_clip(at, low, high);
    if (ca_abs(goal - at) > STILL * extent) {
        /* From behind, so that the length is not small. */
        const ca_real way = goal > at ? extent : -extent, begin = at - way;
        const ca_real end = 1 + (goal - at) / way;
        if (go(p, r, 1, &axis, &begin, &way, end, 0) < end)
            return;
    }
    keep(r, axis, low, high);
}

/* Bring all axes of a group as near to their demands as possible, by the same share. */
static void approach(const ca_vectored *p, run *r, int count, const int *group, const ca_real *u)
{
    int axes[CA_M], rows = 0;
    ca_real shares[CA_M], longest = LAG;
    for (int i = 0; i < count; i++) {
        const int k = group[i];
        shares[k] = ca_abs(u[k] - p->reference[k]) / p->extent[k];
        longest = ca_max(longest, shares[k]);
        if (r->state[k] == FREE || (r->state[k] == KEPT && r->least[k] < r->most[k]))
            axes[rows++] = k;
    }
    for (int trial = 0; rows && trial < count; trial++) {
        const run before = *r;
        ca_real most = 0, begin[CA_M], way[CA_M];
        for (int i = 0; i < rows; i++) {
            const int k = axes[i];
            const ca_real left = u[k] - wrench(p, r, k);
            way[i] = ca_max(ca_max(shares[k], LAG) / longest, LAG_RATIO) * p->extent[k];
            most = ca_max(most, ca_abs(left) / way[i]);
            way[i] = left < 0 ? -way[i] : way[i];
        }
        if (most <= STILL)
            return;
        for (int i = 0; i < rows; i++)
            begin[i] = u[axes[i]] - most * way[i];
        const ca_real length = go(p, r, rows, axes, begin, way, most, most);
        int beyond[CA_M], any = 0, left = 0;
        for (int i = 0; i < rows; i++) {
            const int k = axes[i];
            const ca_real over = wrench(p, r, k) - u[k];
            beyond[i] = (way[i] < 0 ? -over : over) > PRIORITY_TOLERANCE * p->extent[k];
            any = any || beyond[i];
        }
        for (int i = 0; !any && length >= most && i < rows; i++)
            keep(r, axes[i], u[axes[i]], u[axes[i]]);
        if (!any)
            return;
        /* These can be at their demands, and are not to exceed them. */
        *r = before;
        for (int i = 0; i < rows; i++) {
            if (beyond[i])
                keep(r, axes[i], u[axes[i]], u[axes[i]]);
            else
                axes[left++] = axes[i];
        }
        rows = left;
    }
}

/* Undo a step that moved an axis of the steps before it: near a curved boundary the normal may not
 * be exact enough to tell the face. */
static void check(const ca_vectored *p, const run *before, run *r)
{
    const int steps = r->steps;
    for (int k = 0; k < (int)p->axes; k++) {
        if (before->state[k] == FREE)
            continue;
        const ca_real kept = wrench(p, before, k), now = wrench(p, r, k);
        const ca_real rounding = MOVED * p->extent[k];
        const int held = before->state[k] == KEPT;
        if (now < (held ? ca_min(kept, before->least[k]) : kept) - rounding ||
            now > (held ? ca_max(kept, before->most[k]) : kept) + rounding) {
            *r = *before;
            r->steps = steps;
            return;
        }
    }
}

/* Take the vectors of least cost that give the same wrench. */
static void settle(const ca_vectored *p, run *r)
{
    const int n = (int)p->components;
    ca_real u[CA_M], z[CA_N], none[CA_M] = {0};
    int axes[CA_M], use[CA_M], rows = 0;
    ca_vectored q;
    ca_vectored_answer answer;
    for (int k = 0; k < (int)p->axes; k++)
        if (r->state[k] != IMPLIED)
            axes[rows++] = k;
    const int used = prepare(p, r, rows, axes, none, none, &q, use);
    for (int i = 0; i < used; i++) {
        const int k = axes[use[i]];
        const ca_real goal = r->least[k] < r->most[k] ? wrench(p, r, k) : r->least[k];
        u[i] = goal - ca_dot(n, p->matrix[k], r->base);
    }
    if (!used)
        return;
    ca_vectored_solve(&q, u, z, &answer);
    r->steps += answer.steps;
    if (answer.attained)
        take(p, r, z);
}

ca_real ca_vectored_prioritize(const ca_vectored *p, const ca_real *u, ca_real *x,
                               ca_vectored_answer *answer)
{
    const int m = (int)p->axes, n = (int)p->components;
    run r, before;
    int order[CA_M], first = 0, on_reference = 1;
    ca_real begin[CA_M], way[CA_M], longest = 0, share = 1;
    memset(&r, 0, sizeof r);
    ca_copy(n, p->middle, r.x);
    for (int i = 0, j = 0; i < (int)p->sets; j += (int)p->size[i], i++) {
        r.whole[i] = 1;
        r.count[i] = (int)p->size[i];
        for (int k = 0; k < r.count[i]; k++)
            r.ways[j + k][k] = 1;
    }
    for (int i = 0; i < m; i++) {
        const int k = order[i] = (int)p->order[i];
        begin[i] = p->line_begin[k];
        way[i] = u[k] - begin[i];
        if (p->group[i] > 0)
            continue;
        first++;
        longest = ca_max(longest, ca_abs(way[i]) / p->extent[k]);
        on_reference = on_reference && begin[i] >= p->reference[k] && begin[i] <= p->reference[k];
    }
    if (longest > STILL) {
        share = go(p, &r, first, order, begin, way, 1, 0);
    } else {
        for (int i = 0; i < first; i++)
            way[i] = p->extent[order[i]];
        go(p, &r, first, order, begin, way, 0, 0);
    }
    for (int i = 0; share >= 1 && i < first; i++)
        keep(&r, order[i], u[order[i]], u[order[i]]);
    for (int i = first; i < m; i++) {
        const int k = order[i];
        before = r;
        if (p->sense[k] > 0)
            bring(p, &r, k, ca_min(u[k], p->reference[k]), ca_max(u[k], p->reference[k]));
        check(p, &before, &r);
    }
    for (int i = first, count; i < m; i += count) {
        for (count = 1; i + count < m && !(p->group[i + count] > p->group[i]);)
            count++;
        before = r;
        if (count > 1)
            approach(p, &r, count, order + i, u);
        check(p, &before, &r);
        for (int l = i; l < i + count; l++) {
            before = r;
            bring(p, &r, order[l], u[order[l]], u[order[l]]);
            check(p, &before, &r);
        }
    }
    before = r;
    settle(p, &r);
    check(p, &before, &r);
    ca_copy(n, r.x, x);
    answer->level = 1;
    for (int i = 0; i < m; i++) {
        const int k = order[i];
        const ca_real served = wrench(p, &r, k), demand = u[k] - p->reference[k];
        ca_real level = 0;
        if (ca_abs(served - u[k]) <= PRIORITY_TOLERANCE * p->extent[k])
            continue;
        if (i < first && on_reference)
            level = share;
        else if (demand > 0 || demand < 0)
            level = ca_clip((served - p->reference[k]) / demand, 0, 1);
        answer->level = ca_min(answer->level, level);
    }
    answer->steps += r.steps;
    answer->status = CA_PRIORITIZED;
    return share;
}

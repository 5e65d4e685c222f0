/* What the priorities serve of a wrench near the boundary of the admissible set.
 *
 * Newton's method proves that a wrench is unattainable by a plane that has it on one side and all
 * attainable wrenches on the other. Of all wrenches on that other side, attainable or not, the one that
 * the priorities would serve follows from the normal of the plane alone. If it is attainable, they serve
 * it: what is attainable lies on that side, too. Near the boundary it nearly always is, and this takes
 * a small part of the time of the simplex method. Else another plane excludes it, which is tried once.
 */
#include "facet.h"
#include "numbers.h"

/* Share of the greatest rate along the normal below which a rate is none; at most CLEAR it is not clear
 * whether it is. */
#define NONE CA_CHOOSE(1e-10, 1e-6)
#define CLEAR CA_CHOOSE(1e-3, 1e-2)
/* Distance from the plane, as a share of the width of the set, from which on another facet is likely. */
#define DISTANT CA_REAL(0.005)
#define LAG CA_REAL(CA_LAG)
#define LAG_RATIO CA_REAL(CA_LAG_RATIO)

typedef struct {
    const ca_problem *problem;
    const ca_real *u;
    ca_real normal[CA_M]; /* outwards */
    ca_real gap;          /* along the normal: how far u is beyond the plane */
} plane;

/* 1: a rate counts, -1: it is none, 0: it is not clear. */
static int clarity(ca_real rate, ca_real greatest)
{
    return rate > CLEAR * greatest ? 1 : rate > NONE * greatest ? 0 : -1;
}

/* Find the plane that touches the set along a normal, and the thrusts that are at their bounds there.
 * Returns 0 if it is not clear which, or if u is far away. */
static int touch(plane *t, const ca_real *normal, ca_face *face)
{
    const ca_problem *p = t->problem;
    const int n = CA_ROTORS(p), m = CA_AXES(p);
    ca_real rates[CA_N], height = 0, most = 0, greatest = 0, top = 0;
    for (int k = 0; k < m; k++)
        height += normal[k] * (t->u[k] - p->center[k]);
    const ca_real sign = height < 0 ? CA_REAL(-1) : CA_REAL(1);
    for (int k = 0; k < m; k++)
        t->normal[k] = sign * normal[k];
    for (int i = 0; i < n; i++) {
        ca_real rate = 0;
        for (int k = 0; k < m; k++)
            rate += t->normal[k] * p->gamma[k][i];
        rates[i] = rate * p->half_range[i];
        most += ca_abs(rates[i]);
        greatest = ca_max(greatest, ca_abs(rates[i]));
    }
    if (sign * height > (1 + DISTANT) * most)
        return 0;
    for (int i = 0; i < n; i++) {
        const int clear = clarity(ca_abs(rates[i]), greatest);
        face->held[i] = clear > 0;
        face->thrusts[i] = rates[i] > 0 ? p->upper[i] : p->lower[i];
        if (clear > 0)
            top += rates[i] * ((face->thrusts[i] - p->middle[i]) / p->half_range[i]);
        else if (!clear)
            return 0;
    }
    t->gap = sign * height - top;
    return 1;
}

/* Distances to the demand by which the axes of a group lag behind it together: 0 for axes along which
 * the plane does not go. Returns 0 if it is not clear for an axis whether it does. */
static int lag(const plane *t, int count, const int *axes, ca_real *parts)
{
    const ca_problem *p = t->problem;
    ca_real longest = LAG, greatest = 0;
    for (int k = 0; k < CA_AXES(p); k++)
        greatest = ca_max(greatest, ca_abs(t->normal[k]) * p->extent[k]);
    for (int i = 0; i < count; i++) {
        const int k = axes[i];
        parts[i] = ca_max(ca_abs(t->u[k] - p->reference[k]) / p->extent[k], LAG);
        longest = ca_max(longest, parts[i]);
    }
    for (int i = 0; i < count; i++) {
        const int k = axes[i], clear = clarity(ca_abs(t->normal[k]) * p->extent[k], greatest);
        if (!clear)
            return 0;
        parts[i] = clear < 0 ? 0 : ca_max(parts[i] / longest, LAG_RATIO) * p->extent[k];
    }
    return 1;
}

/* Give up the parts of the axes of a group, at most to the reference where less important axes must not
 * reverse an axis. Returns 0 if this does not suffice for one axis of several. */
static int give_up(plane *t, int count, const int *axes, const ca_real *parts, ca_real *w)
{
    const ca_problem *p = t->problem;
    ca_real reach = 0, left = 0;
    for (int i = 0; i < count; i++)
        reach += ca_abs(t->normal[axes[i]]) * parts[i];
    for (int i = 0; i < count; i++) {
        const int axis = axes[i];
        const ca_real rate = t->normal[axis], way = t->u[axis] - p->reference[axis];
        ca_real part = (rate < 0 ? -t->gap : t->gap) / reach * parts[i];
        if (p->keep_sense[axis] && ca_abs(part) > 0) {
            const ca_real room = (way > 0) == (rate > 0) ? way : 0;
            if (ca_abs(room) < ca_abs(part)) {
                if (count > 1)
                    return 0;
                left = (part - room) * rate;
                part = room;
            }
        }
        w[axis] -= part;
    }
    t->gap = left;
    return 1;
}

/* Move the first group back on its line. Returns the share of the line that is left. */
static ca_real follow(plane *t, int count, ca_real *w)
{
    const ca_problem *p = t->problem;
    ca_real ways[CA_M], along = 0;
    for (int i = 0; i < count; i++) {
        const int k = p->order[i];
        ways[i] = t->u[k] - (p->center[k] + p->extent[k] * p->begin[i]);
        along += t->normal[k] * ways[i];
    }
    if (!(t->gap < along))
        return -1;
    const ca_real back = t->gap / along;
    for (int i = 0; i < count; i++)
        w[p->order[i]] -= back * ways[i];
    t->gap = 0;
    return 1 - back;
}

/* Choose the wrench w on the inner side of the plane that the priorities would serve. Returns the share
 * of the line that the first group gets, or -1 if the plane does not tell. */
static ca_real choose(plane *t, ca_real *w)
{
    const ca_problem *p = t->problem;
    int last = -1;
    ca_copy(CA_AXES(p), t->u, w);
    for (int end = CA_AXES(p), start = end; end > 0 && t->gap > 0; end = start) {
        ca_real parts[CA_M], along = 0;
        while (start > 0 && p->group[start - 1] == p->group[end - 1])
            start--;
        const int *axes = p->order + start, count = end - start;
        if (!lag(t, count, axes, parts))
            return -1;
        for (int i = 0; i < count; i++)
            along = ca_max(along, parts[i]);
        if (!(along > 0))
            continue;
        if (start == 0 && last >= 0) {
            /* For the first group the last one gives up its sense as well. */
            w[last] -= t->gap / t->normal[last];
            return 1;
        }
        if (start == 0 && count > 1)
            return follow(t, count, w);
        if (!give_up(t, count, axes, parts, w))
            return -1;
        last = last < 0 ? axes[0] : last;
    }
    return t->gap > 0 ? -1 : 1;
}

/* Serve what the plane of a search tells. Returns 0 if it does not tell, or if `w`, which is set, is not
 * known to be attainable. */
static int serve(const ca_problem *p, const ca_real *u, const ca_search *search, ca_served *served,
                 ca_real *thrusts, ca_real *share)
{
    ca_real *w = served->face.wrench;
    plane t = {p, u, {0}, 0};
    *share = touch(&t, search->normal, &served->face) ? choose(&t, w) : -1;
    /* A limit on airmode is for the simplex method. */
    if (*share < 0 || (p->thrust >= 0 && w[p->thrust] > u[p->thrust])) {
        *share = -1;
        return 0;
    }
    return ca_least_norm_at_once(p, &served->face, search->toward, thrusts, search->steps);
}

int ca_serve_at_plane(const ca_problem *p, const ca_search *search, ca_served *served,
                      ca_real *thrusts)
{
    const int m = CA_AXES(p), n = CA_ROTORS(p);
    ca_real missed[CA_M], *w = served->face.wrench, share;
    if (!serve(p, search->wrench, search, served, thrusts, &share)) {
        ca_search other;
        if (share < 0)
            return 0;
        ca_start(p, w, 0, search->steps, &other);
        ca_copy(m, search->y, other.y);
        if (!ca_attempt(p, &other, thrusts) &&
            !(other.unattainable && serve(p, search->wrench, &other, served, thrusts, &share)))
            return 0;
    }
    ca_copy(n, thrusts, served->face.thrusts);
    ca_leave(p, w, thrusts, missed);
    for (int k = 0; k < m; k++)
        w[k] -= missed[k];
    ca_judge(p, search->wrench, share, 0, served);
    return 1;
}

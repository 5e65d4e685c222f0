/* What the priorities serve of a wrench near the boundary of the admissible set.
 *
 * Newton's method proves that a wrench is unattainable by a plane that has it on one side and all
 * attainable wrenches on the other. Of all wrenches on that other side, attainable or not, the
 * simplex method finds the one that the priorities would serve at once. If it is attainable, they
 * serve it: what is attainable lies on that side, too. Near the boundary it nearly always is, and
 * this takes a small part of the time of the simplex method within the bounds of the thrusts.
 * Else another plane excludes it, which is added: a cutting-plane method.
 */
#include "facet.h"
#include "numbers.h"

/* Distance from the plane, as a share of the width of the set, from which on another facet is
 * likely. */
#define DISTANT CA_REAL(0.005)
/* Number of planes after which the simplex method has the thrusts as variables. */
#define PLANES 2

/* Find the plane that touches the set along the normal of a search, and the thrusts that are at their
 * bounds there. Returns 0 if it is not clear which, or if u is far away. */
static int touch(const ca_problem *p, const ca_real *u, const ca_search *search, ca_plane *plane)
{
    const int n = CA_ROTORS(p), m = CA_AXES(p);
    ca_real rates[CA_N], sizes[CA_N], height = 0, most = 0, greatest = 0;
    for (int k = 0; k < m; k++)
        height += search->normal[k] * (u[k] - p->center[k]);
    const ca_real sign = height < 0 ? CA_REAL(-1) : CA_REAL(1);
    for (int k = 0; k < m; k++)
        plane->normal[k] = sign * search->normal[k];
    for (int i = 0; i < n; i++) {
        ca_real rate = 0;
        for (int k = 0; k < m; k++)
            rate += plane->normal[k] * p->gamma[k][i];
        rates[i] = rate;
        sizes[i] = ca_abs(rate * p->half_range[i]);
        most += sizes[i];
        greatest = ca_max(greatest, sizes[i]);
    }
    if (sign * height > (1 + DISTANT) * most)
        return 0;
    ca_copy(m, search->toward, plane->toward);
    plane->height = 0;
    for (int i = 0; i < n; i++) {
        const int clear = ca_clarity(sizes[i], greatest);
        if (!clear)
            return 0;
        plane->side[i] = clear < 0 ? 0 : rates[i] > 0 ? 1 : -1;
        if (clear > 0)
            plane->height += rates[i] * ((rates[i] > 0 ? p->upper[i] : p->lower[i]) - p->middle[i]);
    }
    return 1;
}

/* Set the face of some planes. Returns 0 if a thrust is at different bounds in two of them. */
static int meet(const ca_problem *p, int count, const ca_plane *planes, const int *touched,
                const ca_real **toward, ca_face *face)
{
    for (int i = 0; i < CA_ROTORS(p); i++) {
        int side = 0;
        for (int j = 0; j < count; j++) {
            if (touched[j] && side * planes[j].side[i] < 0)
                return 0;
            side = touched[j] && planes[j].side[i] ? planes[j].side[i] : side;
        }
        face->held[i] = side != 0;
        face->thrusts[i] = side > 0 ? p->upper[i] : p->lower[i];
    }
    int met = 0;
    for (int j = 0; j < count; j++)
        if (touched[j])
            toward[met++] = planes[j].toward;
    return met;
}

int ca_serve_at_planes(const ca_problem *p, const ca_search *search, ca_served *served,
                       ca_real *thrusts, int *pivots)
{
    const int m = CA_AXES(p), n = CA_ROTORS(p);
    ca_plane planes[PLANES];
    ca_search other = *search;
    ca_face *face = &served->face;
    ca_real missed[CA_M], share;
    for (int count = 1, found = 0; !found; count++) {
        int touched[PLANES];
        const ca_real *toward[PLANES];
        if (count > PLANES || !other.unattainable ||
            !touch(p, search->wrench, &other, &planes[count - 1]) ||
            !ca_serve_within(p, search->wrench, count, planes, face->wrench, touched, &share,
                             pivots))
            return 0;
        const int met = meet(p, count, planes, touched, toward, face);
        other.unattainable = 0;
        found = met && ca_least_norm_at_once(p, face, met, toward, thrusts, &other);
        if (!found && !other.unattainable) {
            ca_real y[CA_M];
            ca_copy(m, other.y, y);
            ca_start(p, face->wrench, 0, search->steps, &other);
            ca_copy(m, y, other.y);
            found = ca_attempt(p, &other, thrusts);
        }
    }
    ca_copy(n, thrusts, face->thrusts);
    ca_leave(p, face->wrench, thrusts, missed);
    for (int k = 0; k < m; k++)
        face->wrench[k] -= missed[k];
    ca_judge(p, search->wrench, share, 0, served);
    return 1;
}

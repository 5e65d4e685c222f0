/* Allocation of vectors in convex sets, and the commands of rotors and servos. */
#include "vectored.h"
#include "numbers.h"
#include "vectored_newton.h"
#include "vectored_priorities.h"

#define AXES CA_VECTORED_AXES
#define COMPONENTS CA_VECTORED_COMPONENTS

/* How far vectors miss a wrench. */
static ca_real missed(const ca_vectored *p, const ca_real *u, const ca_real *x)
{
    ca_real square = 0;
    for (int k = 0; k < AXES(p); k++) {
        const ca_real left = u[k] - ca_dot(COMPONENTS(p), p->matrix[k], x);
        square += left * left;
    }
    return ca_sqrt(square);
}

/* The least share of its demand that an axis gets, from the reference. */
static ca_real least_share(const ca_vectored *p, const ca_real *u, const ca_real *x)
{
    ca_real least = 1;
    for (int k = 0; k < AXES(p); k++) {
        const ca_real served = ca_dot(COMPONENTS(p), p->matrix[k], x) - p->reference[k];
        const ca_real way = u[k] - p->reference[k];
        const ca_real share = way > 0 || way < 0 ? served / way : 1;
        least = ca_min(least, ca_clip(share, 0, 1));
    }
    return least;
}

void ca_vectored_allocate(const ca_vectored *p, const ca_real *u, ca_real *x,
                          ca_vectored_answer *answer)
{
    const int m = AXES(p), n = COMPONENTS(p), policy = (int)p->policy;
    for (int k = 0; k < m; k++)
        if (!ca_is_finite(&u[k])) {
            ca_copy(n, p->resting, x);
            answer->status = CA_INVALID;
            answer->steps = answer->attained = answer->unattainable = 0;
            answer->level = answer->most = 0;
            return;
        }
    ca_vectored_solve(p, u, x, answer);
    const ca_real slack = p->slack * ca_max(1, ca_length(m, u));
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
    if (policy == CA_PRIORITIZED)
        ca_vectored_prioritize(p, u, x, answer);
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

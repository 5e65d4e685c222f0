/* Constants, and functions of numbers and vectors. */
#ifndef CA_ROS_KERNEL_NUMBERS_H
#define CA_ROS_KERNEL_NUMBERS_H

#include <math.h>
#include <stdint.h>
#include <string.h>

#include "problem.h"

#define CA_REAL(x) ((ca_real)(x))

#ifdef CA_FLOAT
#define ca_abs fabsf
#define ca_sqrt sqrtf
#define CA_BITS uint32_t
#define CA_MANTISSA 23
#define CA_EXPONENT 127
#define CA_CHOOSE(in_double, in_float) ((ca_real)(in_float))
#define CA_CHOOSE_INT(in_double, in_float) (in_float)
#else
#define ca_abs fabs
#define ca_sqrt sqrt
#define CA_BITS uint64_t
#define CA_MANTISSA 52
#define CA_EXPONENT 1023
#define CA_CHOOSE(in_double, in_float) ((ca_real)(in_double))
#define CA_CHOOSE_INT(in_double, in_float) (in_double)
#endif

/* With CA_FIXED all problems have CA_N rotors and CA_M axes, and loops have constant lengths; with
 * CA_FIXED_AXES this is so for the axes. */
#ifdef CA_FIXED
#define CA_FIXED_AXES
#define CA_ROTORS(problem) ((void)(problem), CA_N)
#else
#define CA_ROTORS(problem) ((problem)->n)
#endif
#ifdef CA_FIXED_AXES
#define CA_AXES(problem) ((void)(problem), CA_M)
#else
#define CA_AXES(problem) ((problem)->m)
#endif

/* Tolerances, and why they have their values. Those that NumPy has too have the same name there, without
 * CA_, and the same value in double precision; test/test_rounding.py compares them. eps is 2.2e-16, in
 * single precision 1.2e-7. Thrusts, axes and rates are scaled to the order of 1.
 *
 * name               double  single  why
 * CA_EXACT_TOLERANCE  1e-12   1e-5   some 100 eps: what sums of 32 terms and two solutions leave
 * EXACT_SUM           4 eps   4 eps  a sum Gamma f with large terms cannot be nearer to the wrench
 * AIM                 0.5     0.5    leaves the other half to sums in another order
 * SUM                 1e-14   1e-6   rounding of a sum of up to 38 terms along a step
 * IMAGE_ROUNDING     16 eps  16 eps  of thrusts of multipliers y, which has 6 terms, as a share of |y|
 * CHANGED             1e-10   1e-5   well above IMAGE_ROUNDING for |y| up to STEEP
 * STILL               1e-12   1e-6   rounding of a rate that is zero; its rotor would end far away
 * SINGULAR_MIN        1e-8    1e-4   half of the digits: a norm whose square is eps
 * DEPENDENT           1e-13   1e-4   rounding of the rest of a row by the Gram-Schmidt method
 * WELL                1e-2    3e-2   normal equations, which square it, lose up to 4 and 3 digits
 * STEEP               2e4     2e2    multipliers that no facet has but those parallel to 5e-5 and 5e-3
 * FULL_SLACK, SAME    0.05, 1e-7, single 1e-4: how much slack is used, and when; docs/exact.md
 * SPANNING_MIN        1e-9    1e-5   axes with fewer independent digits would lose their tolerance
 * ZERO                1e-8    1e-6   a rate that moves an axis by less than motors can follow
 * RATE_MIN            1e-9    1e-6   below ZERO, so that what blocks is not what a push has ignored
 * NOISE               1e-13   1e-6   rounding of a rate after some pivots
 * MAGNIFIED           1e-3    1e-3   SLACK over it is some eps: a rate after a small pivot, whose error it has
 * UNCLEAR             0       3e-3   rounding after pivots of this size: a decision that needs digits
 * SLACK               1e-12   1e-6   rounding of a variable after some moves
 * ERROR_FACTOR        10      1      pivots after one another, each with its error
 * PARALLEL            1e-3    1e-3   facets that a wrench 1e-9 away exchanges: no face is taken
 * AT_BOUND, NEAR: 0.1, 1e-3, SPREAD: 0.9: no basis begins where a thrust blocks at once, with a small
 *                     pivot
 * INSIDE, LAG, LAG_RATIO, REST: 0.99, 1e-3, 1e-6, 1e-9: of the priorities, not of rounding
 * NONE, CLEAR         1e-10, 1e-3, single 1e-6, 1e-2: a normal of rounded factors; between them it is
 *                     left to the simplex method
 * CA_ABSURD           1e100   1e12   its square is finite
 */
/* Residual of an exact allocation, relative to max(1, |u|). */
#define CA_EXACT_TOLERANCE CA_CHOOSE(1e-12, 1e-5)
/* Greatest number of a wrench or a problem. Its square is finite. */
#define CA_ABSURD CA_CHOOSE(1e100, 1e12)
/* Stands for infinity, which -ffast-math excludes: greater than what all sums and quotients give. */
#define CA_UNBOUNDED CA_CHOOSE(1e300, 1e36)

/* Whether a number is finite, and at most CA_ABSURD in size. This compares bits, since compilers with
 * -ffast-math may remove a comparison that only NaN or infinity fails. */
static inline int ca_is_finite(const ca_real *x)
{
    const ca_real greatest = CA_ABSURD;
    CA_BITS bits, limit;
    memcpy(&bits, x, sizeof bits);
    memcpy(&limit, &greatest, sizeof limit);
    return (bits & ((CA_BITS)-1 >> 1)) <= limit;
}

/* a == b, without the warning of compilers: where this is asked, numbers were copied. */
static inline int ca_equal(ca_real a, ca_real b) { return a <= b && a >= b; }

static inline ca_real ca_min(ca_real a, ca_real b) { return a < b ? a : b; }
static inline ca_real ca_max(ca_real a, ca_real b) { return a > b ? a : b; }

static inline ca_real ca_clip(ca_real x, ca_real lower, ca_real upper)
{
    return ca_min(ca_max(x, lower), upper);
}

static inline ca_real ca_dot(int count, const ca_real *a, const ca_real *b)
{
    ca_real sum = 0;
    for (int i = 0; i < count; i++)
        sum += a[i] * b[i];
    return sum;
}

static inline ca_real ca_length(int count, const ca_real *a)
{
    return ca_sqrt(ca_dot(count, a, a));
}

/* Thrust at a rotor speed w: a w^2 + b w + c of the last of the segments (start, a, b, c) that has
 * begun there. */
static inline ca_real ca_curve(int count, const ca_real (*segments)[4], ca_real w)
{
    const ca_real *segment = segments[--count];
    while (count > 0 && w < *segment)
        segment = segments[--count];
    return (segment[1] * w + segment[2]) * w + segment[3];
}

/* Whether a wrench is finite, and its length at most CA_ABSURD. */
static inline int ca_is_wrench(int m, const ca_real *u)
{
    for (int k = 0; k < m; k++)
        if (!ca_is_finite(&u[k]))
            return 0;
    return ca_length(m, u) <= CA_ABSURD;
}

/* Natural logarithm of a positive number of at least 1e-30, the same on every machine: libraries
 * differ in the last bits. The number is m 2^e with m from sqrt(1/2) to sqrt(2), and
 * ln m = 2 artanh((m - 1) / (m + 1)). */
static inline ca_real ca_log(ca_real x)
{
    const ca_real root = CA_REAL(1.4142135623730951);
    ca_real sum = 0;
    CA_BITS bits;
    memcpy(&bits, &x, sizeof bits);
    int exponent = (int)(bits >> CA_MANTISSA) - CA_EXPONENT;
    bits -= (CA_BITS)exponent << CA_MANTISSA;
    memcpy(&x, &bits, sizeof x);
    if (x > root) {
        x *= CA_REAL(0.5);
        exponent++;
    }
    const ca_real part = (x - 1) / (x + 1), square = part * part;
    for (int k = CA_CHOOSE_INT(23, 9); k > 0; k -= 2)
        sum = sum * square + 1 / (ca_real)k;
    return 2 * part * sum + (ca_real)exponent * CA_REAL(0.69314718055994531);
}

static inline void ca_copy(int count, const ca_real *from, ca_real *to)
{
    for (int i = 0; i < count; i++)
        to[i] = from[i];
}

#endif

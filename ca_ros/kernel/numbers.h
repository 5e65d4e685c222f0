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

/* Residual of an exact allocation, relative to max(1, |u|). */
#define CA_TOLERANCE CA_CHOOSE(1e-12, 1e-5)
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

{% set forwards, backwards, slowest, fastest = zip(*firmware.rotors) %}
{% set square = firmware.curve.square %}
{% set inverse = 'ca_speeds' if square else 'curve_speeds' %}
/* The constants of the vehicle {{ name }}, for each fault, and the function of {{ name }}.h.
 * Written by the command firmware of ca_ros. */
#include "{{ name }}.h"
#include "numbers.h"

static const ca_problem problems[{{ NAME }}_FAULTS] = {
{{ problems }}
};

/* The component of the wrench that each axis of a problem is. */
static const int axes[{{ NAME }}_FAULTS][CA_M] = {
{{ commanded | rows }}
};

/* Thrust over squared speed [kg m]; 1 for a lost rotor. */
static const ca_real thrust_coefficient[{{ NAME }}_FAULTS][CA_N] = {
{{ forwards | rows }}
};

/* The same of rotors that turn backwards. */
static const ca_real reverse_coefficient[{{ NAME }}_FAULTS][CA_N] = {
{{ backwards | rows }}
};

/* Bounds of the speeds [rad/s]. */
static const ca_real speed_min[{{ NAME }}_FAULTS][CA_N] = {
{{ slowest | rows }}
};

static const ca_real speed_max[{{ NAME }}_FAULTS][CA_N] = {
{{ fastest | rows }}
};

/* Whether the vehicle still hovers level. */
static const int level[{{ NAME }}_FAULTS] = { {{- firmware.level | map('int') | join(', ') -}} };

/* What each rotor delivers of its thrust. */
static const ca_real healths[{{ NAME }}_FAULTS][CA_N] = {
{{ firmware.health | rows }}
};
{% if not square %}
{% set starts, levels, segments = firmware.segments %}

/* The thrust curve: start w [rad/s], a, b, c of each segment, of thrust a w^2 + b w + c, and the
 * thrust at its start [N]. Thrust coefficients are relative to that of the curve. */
static const ca_real levels[{{ levels | length }}] = {{ levels | literal | indented | trim }};
static const ca_real segments[{{ levels | length }}][4] = {
{% for start, abc in zip(starts, segments) %}
{{ [[start] + abc.tolist()] | rows }}
{% endfor %}
};

static void curve_speeds(int n, const ca_real *thrusts, const ca_real *scale,
    const ca_real *reverse, const ca_real *low, const ca_real *high, ca_real *speeds)
{
    (void)reverse; /* rotors with a curve do not reverse */
    for (int i = 0; i < n; i++) {
        const ca_real f = (thrusts[i] > 0 ? thrusts[i] : 0) / scale[i];
        int k = {{ levels | length }} - 1;
        while (k > 0 && f < levels[k])
            k--;
        const ca_real a = segments[k][1], b = segments[k][2], rest = f - segments[k][3];
        const ca_real square = b * b + 4 * a * rest;
        const ca_real s = ca_sqrt(square > 0 ? square : 0);
        const ca_real top = b >= 0 ? 2 * rest : s - b, bottom = b >= 0 ? b + s : 2 * a;
        speeds[i] = ca_clip(bottom > 0 || bottom < 0 ? top / bottom : 0, low[i], high[i]);
    }
}
{% endif %}

/* Set u to the commanded components of a wrench. Returns whether the fault and the wrench are sound;
 * axes that are not commanded are checked as well. */
static int command(int fault, const ca_real *wrench, ca_real *u)
{
    if (fault < 0 || fault >= {{ NAME }}_FAULTS)
        return 0;
    for (int k = 0; k < CA_M; k++)
        if (!ca_is_finite(&wrench[k]))
            return 0;
    for (int k = 0; k < problems[fault].m; k++)
        u[k] = wrench[axes[fault][k]];
    return 1;
}

int {{ name }}_fault_of(const ca_real health[{{ NAME }}_ROTORS])
{
    int nearest = {{ NAME }}_OTHER_FAULT;
    ca_real least = CA_UNBOUNDED;
    for (int i = 0; i < CA_N; i++)
        if (!ca_is_finite(&health[i]))
            return {{ NAME }}_OTHER_FAULT;
    for (int fault = 0; fault < {{ NAME }}_FAULTS; fault++) {
        ca_real away = 0, most = 0;
        for (int i = 0; i < CA_N; i++) {
            const ca_real apart = ca_abs(health[i] - healths[fault][i]);
            away += apart * apart;
            most = ca_max(most, apart);
        }
        if (away < least) {
            least = away;
            nearest = level[fault] && 2 * most < 1 ? fault : {{ NAME }}_OTHER_FAULT;
        }
    }
    return nearest;
}

int {{ name }}_allocate(int fault, const ca_real wrench[{{ NAME }}_AXES],
    ca_real speeds[{{ NAME }}_ROTORS])
{
    const int row = fault >= 0 && fault < {{ NAME }}_FAULTS ? fault : 0;
    ca_real u[CA_M] = {0}, thrusts[CA_N];
    const int status = command(fault, wrench, u)
        ? ca_allocate(&problems[row], u, thrusts).status : CA_INVALID;
    if (status == CA_INVALID || status == CA_REJECTED) {
        for (int i = 0; i < CA_N; i++)
            speeds[i] = ca_clip(0, speed_min[row][i], speed_max[row][i]);
    } else {
        {{ inverse }}(CA_N, thrusts, thrust_coefficient[row], reverse_coefficient[row],
            speed_min[row], speed_max[row], speeds);
    }
    return status;
}

{% if firmware.rates %}
/* Greatest rates at which the speeds grow and shrink [rad/s^2]. */
static const ca_real acceleration_max[CA_N] = {{ firmware.rates[0] | literal }};
static const ca_real deceleration_max[CA_N] = {{ firmware.rates[1] | literal }};
{% if not square %}


/* `ca_narrow` for the thrust curve. */
static void curve_narrow(ca_problem *problem, const ca_real *speeds, ca_real time,
    const ca_real *up, const ca_real *down, const ca_real *scale, const ca_real *reverse,
    const ca_real *low, const ca_real *high, ca_real *least, ca_real *greatest)
{
    const ca_real *last = segments[{{ levels | length }} - 1];
    ca_real lower[CA_N], upper[CA_N];
    (void)reverse;
    ca_reach(CA_N, speeds, time, up, down, low, high, least, greatest);
    for (int i = 0; i < CA_N; i++) {
        const ca_real k = scale[i], from = least[i], to = greatest[i];
        /* Most speeds are in the last segment. */
        const int within = from >= last[0];
        lower[i] = k * (within ? (last[1] * from + last[2]) * from + last[3]
                               : ca_curve({{ levels | length }}, segments, from));
        upper[i] = k * (within ? (last[1] * to + last[2]) * to + last[3]
                               : ca_curve({{ levels | length }}, segments, to));
    }
    ca_set_bounds(problem, lower, upper);
}
{% endif %}

int {{ name }}_allocate_within(int fault, const ca_real wrench[{{ NAME }}_AXES], ca_real time,
    ca_real speeds[{{ NAME }}_ROTORS])
{
    const int row = fault >= 0 && fault < {{ NAME }}_FAULTS ? fault : 0;
    ca_real u[CA_M] = {0}, thrusts[CA_N], least[CA_N], greatest[CA_N];
    int status = CA_INVALID;
    /* The problem of the last fault, whose bounds each call moves. */
    static ca_problem moved;
    static int copied = -1;
    if (copied != row) {
        moved = problems[row];
        copied = row;
    }
    const ca_real elapsed = ca_is_finite(&time) ? ca_clip(time, 0, {{ NAME }}_TIME_MAX) : 0;
    {{ 'ca_narrow' if square else 'curve_narrow' }}(&moved, speeds, elapsed, acceleration_max, deceleration_max,
        thrust_coefficient[row], reverse_coefficient[row], speed_min[row], speed_max[row], least,
        greatest);
    if (command(fault, wrench, u))
        status = ca_allocate(&moved, u, thrusts).status;
    if (status == CA_INVALID || status == CA_REJECTED) {
        for (int i = 0; i < CA_N; i++)
            speeds[i] = ca_clip(0, least[i], greatest[i]);
    } else {
        {{ inverse }}(CA_N, thrusts, thrust_coefficient[row], reverse_coefficient[row], least,
            greatest, speeds);
    }
    return status;
}

{% endif %}
ca_real {{ name }}_margin(int fault, const ca_real wrench[{{ NAME }}_AXES])
{
    ca_real u[CA_M] = {0};
    return command(fault, wrench, u) ? ca_margin(&problems[fault], u) : -CA_UNBOUNDED;
}
{% if has_throttles %}
{% set points, full = throttles.tables(firmware) %}
{% set curve, cast = firmware.curve, firmware.dtype %}
{% set low, high = curve.pwm %}

static const ca_real full[CA_N] = {{ full | literal }};
{% if points | length %}

/* Measured speeds, throttles, and slopes from there on. */
static const ca_real points[{{ points | length }}][3] = {
{{ points | rows }}
};
{% endif %}

void {{ name }}_throttles(const ca_real speeds[{{ NAME }}_ROTORS], ca_real throttles[{{ NAME }}_ROTORS],
    ca_real pulses[{{ NAME }}_ROTORS])
{
    for (int i = 0; i < CA_N; i++) {
        const ca_real w = ca_abs(speeds[i]);
{% if points | length %}
        const ca_real speed = w * full[i];
        int k = {{ points | length }} - 1;
        while (k > 0 && speed < points[k][0])
            k--;
        const ca_real found = points[k][1] + points[k][2] * (speed - points[k][0]);
{% else %}
{% set thrust = 'w * w' if square else 'ca_curve(%d, segments, w)' % levels | length %}
        const ca_real share = ca_min({{ thrust }} / full[i], 1), b = {{ cast(1.0 - curve.expo) | literal }};
        const ca_real bottom = b + ca_sqrt(b * b + 4 * {{ cast(curve.expo) | literal }} * share);
        const ca_real found = bottom > 0 ? 2 * share / bottom : 0;
{% endif %}
        throttles[i] = speeds[i] < 0 ? -found : found;
        pulses[i] = {{ cast(low) | literal }} + {{ cast(high - low) | literal }} * (speed_min[0][i] < 0 ? {{ cast(0.5) | literal }} + {{ cast(0.5) | literal }} * throttles[i] : throttles[i]);
    }
}
{% endif %}

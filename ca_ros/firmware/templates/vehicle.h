/* Control allocation of the vehicle {{ name }}: a wrench in, rotor speeds out. README.md explains it.
 * Written by the command firmware of ca_ros. */
#ifndef {{ NAME }}_ALLOCATION_H
#define {{ NAME }}_ALLOCATION_H

#include "exact.h"

#ifdef __cplusplus
extern "C" {
#endif

#define {{ NAME }}_ROTORS {{ firmware.columns }}
#define {{ NAME }}_AXES {{ axes | length }}
#define {{ NAME }}_FAULTS {{ firmware.faults | length }}

/* What is known of the rotors. Axes that a fault takes away are not commanded. */
enum {{ name }}_fault {
{% for fault in firmware.faults %}
{% set lost = axes | reject('in', fault.problem.axes) | join(', ') %}
    {{ NAME }}_{{ fault.constant }} = {{ loop.index0 }}, /* {{ fault.meaning }}{{ '; not commanded: ' ~ lost if lost }} */
{% endfor %}
    {{ NAME }}_OTHER_FAULT = -1 /* none of these */
};

/* The fault for the health of each rotor, from 0 to 1: the one whose health is nearest. With one of two
 * coaxial rotors lost, and not known which, both have half of it. {{ NAME }}_OTHER_FAULT if a
 * rotor's health differs from that of each fault by 0.5 or more, as with two rotors lost where that is no
 * fault, or is not finite, or if the vehicle cannot hover level with the fault: no allocation saves it
 * then, and acting on a false alarm loses it. Allocation refuses it as CA_INVALID, with all rotors at the
 * speed nearest to zero: to fly on, pass the last fault that was known. */
int {{ name }}_fault_of(const ca_real health[{{ NAME }}_ROTORS]);

/* Find the rotor speeds for a wrench.
 *
 * fault   an enum {{ name }}_fault
 * wrench  in the body frame, x forward, y left, z up:
{% for axis in axes %}
 *         [{{ loop.index0 }}] {{ axis }} [{{ axis | unit }}]
{% endfor %}
 * speeds  of each rotor, in the order of the vehicle's file [rad/s]
 *
 * Returns an enum ca_status (exact.h). The speeds are finite and within their bounds, whatever the
 * wrench is. If the status is CA_INVALID (the wrench is not finite, or there is no such fault) or
 * CA_REJECTED, all rotors are at the speed nearest to zero. The function keeps no state: it may
 * be called from several threads and interrupts.
 */
int {{ name }}_allocate(int fault, const ca_real wrench[{{ NAME }}_AXES],
    ca_real speeds[{{ NAME }}_ROTORS]);

{% if firmware.rates %}
/* Time since the last call that counts at most [s]. */
#define {{ NAME }}_TIME_MAX {{ period_max | literal }}

/* The same within what the rotors reach at their rates from their speeds, `time` [s] after these.
 * `speeds` are those of the last command, and become those of this one. If bounds that the rates move
 * limit the answer, it is CA_RATE_LIMITED. The bounds need no new set-up. The function has a copy of
 * the problem, so that two tasks must not call it at once; the answer depends on no earlier call. */
int {{ name }}_allocate_within(int fault, const ca_real wrench[{{ NAME }}_AXES], ca_real time,
    ca_real speeds[{{ NAME }}_ROTORS]);

{% endif %}
{% if has_throttles %}
/* Throttles, from 0 to 1 (from -1 for rotors that reverse), and pulse widths [us] of speeds [rad/s],
 * by the thrust curve at the nominal voltage of the vehicle's file. */
void {{ name }}_throttles(const ca_real speeds[{{ NAME }}_ROTORS], ca_real throttles[{{ NAME }}_ROTORS],
    ca_real pulses[{{ NAME }}_ROTORS]);

{% endif %}
/* How far a wrench is from the limits of the rotors: the distance to the nearest facet of the set of
 * attainable wrenches, negative if the wrench is not attainable [N for a facet that limits the
 * thrust, N m for one that limits a torque]; below -1e30 if the wrench or the fault is invalid. It tests
 * all choices of as many rotors as there are axes less one: use it for a low-rate warning, not in the
 * loop. It is as sound in interrupts as the function above. */
ca_real {{ name }}_margin(int fault, const ca_real wrench[{{ NAME }}_AXES]);

#ifdef __cplusplus
}
#endif

#endif

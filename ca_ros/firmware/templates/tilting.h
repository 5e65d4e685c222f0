/* Control allocation of the vehicle {{ name }}: a wrench in, rotor speeds and servo angles out. README.md
 * explains it. Written by the command firmware of ca_ros. */
#ifndef {{ NAME }}_ALLOCATION_H
#define {{ NAME }}_ALLOCATION_H

#include "vectored.h"

#ifdef __cplusplus
extern "C" {
#endif

#define {{ NAME }}_ROTORS {{ firmware.problem.vehicle.n }}
#define {{ NAME }}_SERVOS {{ firmware.problem.vehicle.servos | length }}
#define {{ NAME }}_COMMANDS ({{ NAME }}_ROTORS + {{ NAME }}_SERVOS)
#define {{ NAME }}_AXES {{ axes | length }}
#define {{ NAME }}_FAULTS {{ firmware.faults | length }}

/* What is known of the rotors. Axes that a fault takes away are not commanded. */
enum {{ name }}_fault {
{% for fault in firmware.faults %}
{% set lost = axes | reject('in', fault.problem.axes) | join(', ') %}
    {{ NAME }}_{{ fault.constant }} = {{ loop.index0 }}, /* {{ fault.meaning }}{{ '; not commanded: ' ~ lost if lost }} */
{% endfor %}
};

/* Find rotor speeds and servo angles for a wrench.
 *
 * fault    an enum {{ name }}_fault
 * wrench   in the body frame, x forward, y left, z up:
{% for axis in axes %}
 *         [{{ loop.index0 }}] {{ axis }} [{{ axis | unit }}]
{% endfor %}
 * command  the speed of each rotor [rad/s], then the angle of each servo [rad], in the order of the
 *          rotors in the vehicle's file; a gimbal has two servos, alpha before beta
 *
 * Returns an enum ca_status (problem.h). Speeds and angles are finite and within their bounds, whatever
 * the wrench is. If the status is CA_INVALID (the wrench is not finite, or there is no such fault) or
 * CA_REJECTED, all thrusts are the least. The function keeps no state: it may be called from several
 * threads and interrupts. A servo whose rotor has no thrust goes to the middle of its range: limit the
 * rates of the servos, or leave the angle where it is. */
int {{ name }}_allocate(int fault, const ca_real wrench[{{ NAME }}_AXES],
    ca_real command[{{ NAME }}_COMMANDS]);

#ifdef __cplusplus
}
#endif

#endif

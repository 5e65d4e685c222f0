/* Control allocation of the vehicle $name: a wrench in, rotor speeds out. README.md explains it.
 * Written by the command firmware of ca_ros. */
#ifndef ${NAME}_ALLOCATION_H
#define ${NAME}_ALLOCATION_H

/* All files of the kernel have to be compiled with the same definitions, see vehicle.mk. */
#ifndef CA_N
#define CA_N $n
#endif
#ifndef CA_M
#define CA_M $m
#endif
$precision
#if CA_N != $n || CA_M != $m
#error "compile all files with $definitions"
#endif

#ifdef __cplusplus
extern "C" {
#endif

#include "exact.h"

#define ${NAME}_ROTORS $n
#define ${NAME}_AXES $m
#define ${NAME}_FAULTS $count

/* What is known of the rotors. Axes that a fault takes away are not commanded. */
enum ${name}_fault {
$faults
};

/* Find the rotor speeds for a wrench.
 *
 * fault   an enum ${name}_fault
 * wrench  in the body frame, x forward, y left, z up:
$wrench
 * speeds  of each rotor, in the order of the vehicle's file [rad/s]
 *
 * Returns an enum ca_status (exact.h). The speeds are finite and within their bounds, whatever the
 * wrench is. If the status is CA_INVALID (the wrench is not finite, or there is no such fault) or
 * CA_REJECTED, all rotors are at the speed nearest to zero. The function keeps no state: it may
 * be called from several threads and interrupts.
 */
int ${name}_allocate(int fault, const ca_real wrench[${NAME}_AXES],
    ca_real speeds[${NAME}_ROTORS]);

${rates_header}${throttles_header}/* How far a wrench is from the limits of the rotors: the distance to the nearest facet of the set of
 * attainable wrenches, negative if the wrench is not attainable [N for a facet that limits the
 * thrust, N m for one that limits a torque]; -INFINITY if the wrench or the fault is invalid. It tests
 * all choices of as many rotors as there are axes less one: use it for a low-rate warning, not in the
 * loop. It is as sound in interrupts as the function above. */
ca_real ${name}_margin(int fault, const ca_real wrench[${NAME}_AXES]);

#ifdef __cplusplus
}
#endif

#endif

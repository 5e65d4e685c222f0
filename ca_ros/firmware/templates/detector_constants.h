/* The detector of rotor failures of the vehicle {{ name }}: states and commanded rotor speeds in, the
 * health of the rotors out. Written by the command firmware of ca_ros.
 *
 *     static ca_detector detector; // all memory: sizeof(ca_detector)
 *     static int fault = {{ NAME }}_NO_FAULT;
 *
 *     void start(void)
 *     {
 *         ca_detector_start(&detector, &{{ name }}_detector);
 *     }
 *
 *     // With each state. specific_force is 0 where there is no accelerometer.
 *     void step(int64_t time, const ca_real *attitude, const ca_real *motion,
 *               const ca_real *specific_force, const ca_real *wrench, ca_real *speeds)
 *     {
 *         ca_detector_observe(&detector, time, attitude, motion, specific_force);
 *         // A rotor or arm that was named stays so until ca_detector_reset.
 *         const int found = {{ name }}_fault_of(detector.health);
 *         if (found != {{ NAME }}_OTHER_FAULT) // else the last known: land
 *             fault = found;
 *         {{ name }}_allocate(fault, wrench, speeds);
 *         ca_detector_command(&detector, time, speeds);
 *     }
 */
#ifndef {{ NAME }}_DETECTOR_H
#define {{ NAME }}_DETECTOR_H

#include "detector.h"
#include "{{ name }}.h"

#ifdef __cplusplus
extern "C" {
#endif

extern const ca_detector_model {{ name }}_detector;

#ifdef __cplusplus
}
#endif

#endif

/* The detector of rotor failures of the vehicle {{ name }}: states and commanded rotor speeds in, the
 * health of the rotors out. Written by the command firmware of ca_ros.
 *
 *     static ca_detector detector;                           all memory: sizeof(ca_detector)
 *     ca_detector_start(&detector, &{{ name }}_detector);
 *     ca_detector_command(&detector, time, speeds);          with each command
 *     if (ca_detector_observe(&detector, time, attitude, motion))     with each state
 *         ... detector.health[i] < 1: choose the fault of {{ name }}.h, until ca_detector_reset
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

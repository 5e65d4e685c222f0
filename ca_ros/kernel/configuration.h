/* The sizes of all problems, and the type of all numbers. Here the options of the compiler choose
 * them; exported firmware has a file of this name with those of its vehicle. */
#ifndef CA_ROS_KERNEL_CONFIGURATION_H
#define CA_ROS_KERNEL_CONFIGURATION_H

/* Maximum numbers of rotors and axes. For a single vehicle, define them as its numbers; if all
 * problems have these numbers, define CA_FIXED too, or CA_FIXED_AXES if they have this number of
 * axes, which makes the code faster. Define CA_FLOAT for single precision. */
#ifndef CA_N
#define CA_N 32
#endif
#ifndef CA_M
#define CA_M 6
#endif

#endif

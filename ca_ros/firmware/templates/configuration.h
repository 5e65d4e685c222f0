/* The sizes of the problems of the vehicle {{ name }}, and the type of all numbers. All files include this
 * one: the compiler needs no definitions. Written by the command firmware of ca_ros. */
#ifndef CA_ROS_KERNEL_CONFIGURATION_H
#define CA_ROS_KERNEL_CONFIGURATION_H

{% for constant, value in firmware.definitions.items() %}
#define {{ constant }} {{ value }}
{% endfor %}

#endif

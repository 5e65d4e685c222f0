/* A flight of the vehicle {{ name }} in which rotor 1 fails, a state each 10 ms, and what the same detector
 * answered on the machine that wrote this file. */
#include "{{ name }}_detector.h"

#define VEHICLE "{{ name }}"
#define MODEL {{ name }}_detector

static const struct {
    ca_real state[10]; /* attitude, velocity, angular velocity */
    ca_real speeds[CA_N];
    ca_real health[CA_N], certainty[CA_N];
} flight[] = {
{{ flight | rows }}
};

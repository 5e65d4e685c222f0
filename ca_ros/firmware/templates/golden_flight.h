/* A flight of the vehicle {{ name }} in which rotor 1 fails, a state each 10 ms, and what the same detector
 * answered on the machine that wrote this file. */
#include "{{ name }}_detector.h"

#define VEHICLE "{{ name }}"
#define MODEL {{ name }}_detector

static const struct {
    ca_real state[13]; /* attitude, velocity, angular velocity, specific force */
    ca_real speeds[CA_N];
    ca_real health[CA_N], probabilities[CA_N + 1];
} flight[] = {
{{ flight | rows }}
};

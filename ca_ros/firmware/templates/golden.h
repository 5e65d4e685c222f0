/* Golden vectors of the vehicle {{ name }}: wrenches, and what the same kernel answered on the machine
 * that wrote this file. The first wrenches of each fault are attainable, the next are on the boundary of
 * the admissible set, the next beyond it; the last are special. */
#include <math.h>

#include "{{ name }}.h"

#define VEHICLE "{{ name }}"
#define ALLOCATE {{ name }}_allocate
#define COMMANDS {{ NAME ~ '_COMMANDS' if tilting else 'CA_N' }}
{% if not tilting %}
#define MARGIN {{ name }}_margin
#define FAULT_OF {{ name }}_fault_of

static const struct {
    ca_real health[CA_N];
    int fault;
} healths[] = {
{{ golden.healths(firmware) | rows }}
};
{% endif %}

{% if firmware.rates %}
#define ALLOCATE_WITHIN {{ name }}_allocate_within

static const struct {
    int fault;
    ca_real wrench[CA_M];
    ca_real time;
    int status;
    ca_real speeds[CA_N];
} sequence[] = {
{{ golden.sequence(firmware) | rows }}
};

{% endif %}
{% if has_throttles %}
#define THROTTLES {{ name }}_throttles

static const struct {
    ca_real speeds[CA_N], throttles[CA_N], pulses[CA_N];
} outputs[] = {
{{ throttles.outputs(firmware) | rows }}
};

{% endif %}
static const struct {
    int fault;
    ca_real wrench[CA_M];
    int status;
    ca_real speeds[COMMANDS];
{% if not tilting %}
    ca_real margin;
{% endif %}
} golden[] = {
{{ golden.vectors(firmware) | rows }}
};

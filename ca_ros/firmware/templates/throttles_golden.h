#define THROTTLES ${name}_throttles

static const struct {
    ca_real speeds[CA_N], throttles[CA_N], pulses[CA_N];
} outputs[] = {
$outputs
};


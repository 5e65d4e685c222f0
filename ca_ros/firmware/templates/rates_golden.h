#define ALLOCATE_WITHIN ${name}_allocate_within

static const struct {
    int fault;
    ca_real wrench[CA_M];
    ca_real time;
    int status;
    ca_real speeds[CA_N];
} sequence[] = {
$sequence
};


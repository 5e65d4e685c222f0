/* Compare the answers to the golden vectors, bit by bit. */
#include <stdio.h>
#include <string.h>

#include "golden.h"

int main(void)
{
    const int count = (int)(sizeof golden / sizeof *golden);
    int wrong = 0;
    for (int i = 0; i < count; i++) {
        ca_real speeds[COMMANDS];
        const int status = ALLOCATE(golden[i].fault, golden[i].wrench, speeds);
        int same = status == golden[i].status && !memcmp(speeds, golden[i].speeds, sizeof speeds);
#ifdef MARGIN
        const ca_real margin = MARGIN(golden[i].fault, golden[i].wrench);
        same = same && !memcmp(&margin, &golden[i].margin, sizeof margin);
#endif
        if (same)
            continue;
        if (!wrong++)
            printf("%s: the first difference is in golden vector %d, of fault %d\n", VEHICLE, i,
                   golden[i].fault);
    }
#ifdef FAULT_OF
    for (int i = 0; i < (int)(sizeof healths / sizeof *healths); i++) {
        const int fault = FAULT_OF(healths[i].health);
        if (fault == healths[i].fault)
            continue;
        printf("%s: the fault of health %d is %d, not %d\n", VEHICLE, i, fault, healths[i].fault);
        return 1;
    }
#endif
#ifdef ALLOCATE_WITHIN
    /* A sequence, each from the speeds of the one before. */
    ca_real last[CA_N] = {0};
    for (int i = 0; i < (int)(sizeof sequence / sizeof *sequence); i++) {
        const int status =
            ALLOCATE_WITHIN(sequence[i].fault, sequence[i].wrench, sequence[i].time, last);
        if (status == sequence[i].status && !memcmp(last, sequence[i].speeds, sizeof last))
            continue;
        printf("%s: answer %d of the sequence differs\n", VEHICLE, i);
        return 1;
    }
#endif
#ifdef THROTTLES
    for (int i = 0; i < (int)(sizeof outputs / sizeof *outputs); i++) {
        ca_real throttles[CA_N], pulses[CA_N];
        THROTTLES(outputs[i].speeds, throttles, pulses);
        if (!memcmp(throttles, outputs[i].throttles, sizeof throttles) &&
            !memcmp(pulses, outputs[i].pulses, sizeof pulses))
            continue;
        printf("%s: throttles %d differ\n", VEHICLE, i);
        return 1;
    }
#endif
    printf("%s: %d of %d golden vectors are reproduced to the last bit\n", VEHICLE, count - wrong,
           count);
    return wrong != 0;
}

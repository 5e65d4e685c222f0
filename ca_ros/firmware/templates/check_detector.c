/* Compare the answers of the detector to those of the golden flight, bit by bit. */
#include <stdio.h>
#include <string.h>

#include "golden_flight.h"

int main(void)
{
    static ca_detector detector;
    const int count = (int)(sizeof flight / sizeof *flight);
    int wrong = 0;
    ca_detector_start(&detector, &MODEL);
    for (int i = 0; i < count; i++) {
        const int64_t time = (int64_t)i * 10000000;
        ca_detector_observe(&detector, time, flight[i].state, flight[i].state + 4,
                            flight[i].state + 10);
        ca_detector_command(&detector, time, flight[i].speeds);
        if (!memcmp(detector.health, flight[i].health, sizeof detector.health) &&
            !memcmp(detector.probabilities, flight[i].probabilities,
                    sizeof detector.probabilities))
            continue;
        if (!wrong++)
            printf("%s: the first difference is after state %d of the golden flight\n", VEHICLE,
                   i);
    }
    printf("%s: %d of %d golden vectors are reproduced to the last bit (detector)\n", VEHICLE,
           count - wrong, count);
    return wrong != 0;
}

{% set forwards, backwards, slowest, fastest = zip(*firmware.rotors) %}
{% set thrust_min, thrust_max, servos, angle_middle, angle_min, angle_max = zip(*firmware.servos) %}
/* The constants of the vehicle {{ name }}, for each fault, and the function of {{ name }}.h.
 * Written by the command firmware of ca_ros. */
#include "{{ name }}.h"
#include "numbers.h"

static const ca_vectored problems[{{ NAME }}_FAULTS] = {
{{ problems }}
};

/* The component of the wrench that each axis of a problem is. */
static const int axes[{{ NAME }}_FAULTS][CA_M] = {
{{ commanded | rows }}
};

/* Bounds of the thrusts [N]. */
static const ca_real thrust_min[{{ NAME }}_FAULTS][{{ NAME }}_ROTORS] = {
{{ thrust_min | rows }}
};

static const ca_real thrust_max[{{ NAME }}_FAULTS][{{ NAME }}_ROTORS] = {
{{ thrust_max | rows }}
};

/* Number of servos of each rotor, and their angles: the middle and the limits [rad]. */
static const int servos[{{ NAME }}_FAULTS][{{ NAME }}_ROTORS] = {
{{ servos | rows }}
};

static const ca_real angle_middle[{{ NAME }}_FAULTS][{{ NAME }}_SERVOS] = {
{{ angle_middle | rows }}
};

static const ca_real angle_min[{{ NAME }}_FAULTS][{{ NAME }}_SERVOS] = {
{{ angle_min | rows }}
};

static const ca_real angle_max[{{ NAME }}_FAULTS][{{ NAME }}_SERVOS] = {
{{ angle_max | rows }}
};

/* Thrust over squared speed [kg m]; 1 for a lost rotor. */
static const ca_real thrust_coefficient[{{ NAME }}_FAULTS][{{ NAME }}_ROTORS] = {
{{ forwards | rows }}
};

/* Bounds of the speeds [rad/s]. */
static const ca_real speed_min[{{ NAME }}_FAULTS][{{ NAME }}_ROTORS] = {
{{ slowest | rows }}
};

static const ca_real speed_max[{{ NAME }}_FAULTS][{{ NAME }}_ROTORS] = {
{{ fastest | rows }}
};

int {{ name }}_allocate(int fault, const ca_real wrench[{{ NAME }}_AXES],
    ca_real command[{{ NAME }}_COMMANDS])
{
    const int known = fault >= 0 && fault < {{ NAME }}_FAULTS, row = known ? fault : 0;
    ca_real u[CA_M] = {0}, x[CA_N];
    ca_vectored_answer answer;
    int sound = known;
    for (int k = 0; k < CA_M; k++)
        sound = sound && ca_is_finite(&wrench[k]);
    for (int k = 0; k < (int)problems[row].axes; k++)
        u[k] = sound ? wrench[axes[row][k]] : CA_UNBOUNDED;
    ca_vectored_allocate(&problems[row], u, x, &answer);
    ca_vectored_command(&problems[row], x, thrust_min[row], thrust_max[row], servos[row],
        angle_middle[row], angle_min[row], angle_max[row], command, command + {{ NAME }}_ROTORS);
    for (int i = 0; i < {{ NAME }}_ROTORS; i++)
        command[i] = ca_clip(ca_sqrt(command[i] / thrust_coefficient[row][i]), speed_min[row][i],
            speed_max[row][i]);
    return answer.status;
}

/* The constants of the vehicle $name, for each fault, and the function of $name.h.
 * Written by the command firmware of ca_ros. */
#include "$name.h"
#include "numbers.h"

static const ca_problem problems[${NAME}_FAULTS] = {
$problems
};

/* The component of the wrench that each axis of a problem is. */
static const int axes[${NAME}_FAULTS][CA_M] = {
$axes
};

/* Thrust over squared speed [kg m]; 1 for a lost rotor. */
static const ca_real thrust_coefficient[${NAME}_FAULTS][CA_N] = {
$thrust_coefficient
};

/* The same of rotors that turn backwards. */
static const ca_real reverse_coefficient[${NAME}_FAULTS][CA_N] = {
$reverse_coefficient
};

/* Bounds of the speeds [rad/s]. */
static const ca_real speed_min[${NAME}_FAULTS][CA_N] = {
$speed_min
};

static const ca_real speed_max[${NAME}_FAULTS][CA_N] = {
$speed_max
};

int ${name}_allocate(int fault, const ca_real wrench[${NAME}_AXES],
    ca_real speeds[${NAME}_ROTORS])
{
    const int known = fault >= 0 && fault < ${NAME}_FAULTS, row = known ? fault : 0;
    int status = known ? CA_EXACT : CA_INVALID;
    ca_real u[CA_M] = {0}, thrusts[CA_N];

    /* Axes that are not commanded are checked as well. */
    for (int k = 0; k < CA_M; k++)
        if (!(ca_abs(wrench[k]) <= CA_ABSURD))
            status = CA_INVALID;
    if (status != CA_INVALID) {
        for (int k = 0; k < problems[row].m; k++)
            u[k] = wrench[axes[row][k]];
        status = ca_allocate(&problems[row], u, thrusts).status;
    }
    if (status == CA_INVALID || status == CA_REJECTED) {
        for (int i = 0; i < CA_N; i++)
            speeds[i] = ca_clip(0, speed_min[row][i], speed_max[row][i]);
    } else {
        ca_speeds(CA_N, thrusts, thrust_coefficient[row], reverse_coefficient[row],
            speed_min[row], speed_max[row], speeds);
    }
    return status;
}

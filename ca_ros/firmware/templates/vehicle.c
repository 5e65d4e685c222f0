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
$curve
/* Set u to the commanded components of a wrench. Returns whether the fault and the wrench are sound;
 * axes that are not commanded are checked as well. */
static int command(int fault, const ca_real *wrench, ca_real *u)
{
    if (fault < 0 || fault >= ${NAME}_FAULTS)
        return 0;
    for (int k = 0; k < CA_M; k++)
        if (!(ca_abs(wrench[k]) <= CA_ABSURD))
            return 0;
    for (int k = 0; k < problems[fault].m; k++)
        u[k] = wrench[axes[fault][k]];
    return 1;
}

int ${name}_allocate(int fault, const ca_real wrench[${NAME}_AXES],
    ca_real speeds[${NAME}_ROTORS])
{
    const int row = fault >= 0 && fault < ${NAME}_FAULTS ? fault : 0;
    ca_real u[CA_M] = {0}, thrusts[CA_N];
    const int status = command(fault, wrench, u)
        ? ca_allocate(&problems[row], u, thrusts).status : CA_INVALID;
    if (status == CA_INVALID || status == CA_REJECTED) {
        for (int i = 0; i < CA_N; i++)
            speeds[i] = ca_clip(0, speed_min[row][i], speed_max[row][i]);
    } else {
        $speeds(CA_N, thrusts, thrust_coefficient[row], reverse_coefficient[row],
            speed_min[row], speed_max[row], speeds);
    }
    return status;
}

${rates}ca_real ${name}_margin(int fault, const ca_real wrench[${NAME}_AXES])
{
    ca_real u[CA_M] = {0};
    return command(fault, wrench, u) ? ca_margin(&problems[fault], u) : -CA_INFINITY;
}
$throttles
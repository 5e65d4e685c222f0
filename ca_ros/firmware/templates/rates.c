
/* Greatest rates at which the speeds grow and shrink [rad/s^2]. */
static const ca_real acceleration_max[CA_N] = $acceleration;
static const ca_real deceleration_max[CA_N] = $deceleration;
$curve_narrow
int ${name}_allocate_within(int fault, const ca_real wrench[${NAME}_AXES], ca_real time,
    ca_real speeds[${NAME}_ROTORS])
{
    const int row = fault >= 0 && fault < ${NAME}_FAULTS ? fault : 0;
    ca_real u[CA_M] = {0}, thrusts[CA_N], least[CA_N], greatest[CA_N];
    int status = CA_INVALID;
    /* The problem of the last fault, whose bounds each call moves. */
    static ca_problem moved;
    static int copied = -1;
    if (copied != row) {
        moved = problems[row];
        copied = row;
    }
    const ca_real elapsed = ca_clip(time, 0, ${NAME}_TIME_MAX);
    $narrow(&moved, speeds, elapsed, acceleration_max, deceleration_max,
        thrust_coefficient[row], reverse_coefficient[row], speed_min[row], speed_max[row], least,
        greatest);
    if (command(fault, wrench, u))
        status = ca_allocate(&moved, u, thrusts).status;
    if (status == CA_INVALID || status == CA_REJECTED) {
        for (int i = 0; i < CA_N; i++)
            speeds[i] = ca_clip(0, least[i], greatest[i]);
    } else {
        $speeds(CA_N, thrusts, thrust_coefficient[row], reverse_coefficient[row], least,
            greatest, speeds);
    }
    return status;
}

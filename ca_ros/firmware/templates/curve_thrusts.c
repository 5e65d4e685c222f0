
static void curve_thrusts(int n, const ca_real *speeds, const ca_real *thrust_coefficient,
    ca_real *thrusts)
{
    for (int i = 0; i < n; i++)
        thrusts[i] = thrust_coefficient[i] * ca_curve($count, segments, speeds[i]);
}

/* `ca_narrow` for the thrust curve. */
static void curve_narrow(ca_problem *problem, const ca_real *speeds, ca_real time,
    const ca_real *up, const ca_real *down, const ca_real *thrust_coefficient,
    const ca_real *reverse_coefficient, const ca_real *low, const ca_real *high, ca_real *least,
    ca_real *greatest)
{
    ca_real lower[CA_N], upper[CA_N];
    (void)reverse_coefficient;
    ca_reach(CA_N, speeds, time, up, down, low, high, least, greatest);
    curve_thrusts(CA_N, least, thrust_coefficient, lower);
    curve_thrusts(CA_N, greatest, thrust_coefficient, upper);
    ca_set_bounds(problem, lower, upper);
}


static void curve_thrusts(int n, const ca_real *speeds, const ca_real *thrust_coefficient,
    const ca_real *reverse_coefficient, ca_real *thrusts)
{
    (void)reverse_coefficient;
    for (int i = 0; i < n; i++)
        thrusts[i] = thrust_coefficient[i] * ca_curve($count, segments, speeds[i]);
}

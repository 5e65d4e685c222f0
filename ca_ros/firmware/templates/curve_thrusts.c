
/* Each segment of the thrust curve begins at one of these speeds [rad/s]. */
static const ca_real starts[$count] = $starts;

static void curve_thrusts(int n, const ca_real *speeds, const ca_real *thrust_coefficient,
    const ca_real *reverse_coefficient, ca_real *thrusts)
{
    (void)reverse_coefficient;
    for (int i = 0; i < n; i++) {
        const ca_real w = speeds[i];
        int k = $count - 1;
        while (k > 0 && w < starts[k])
            k--;
        thrusts[i] = thrust_coefficient[i]
            * ((segments[k][0] * w + segments[k][1]) * w + segments[k][2]);
    }
}

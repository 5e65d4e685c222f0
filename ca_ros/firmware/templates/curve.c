/* The thrust curve: start w [rad/s], a, b, c of each segment, of thrust a w^2 + b w + c, and the
 * thrust at its start [N]. Thrust coefficients are relative to that of the curve. */
static const ca_real levels[$count] = $levels;
static const ca_real segments[$count][4] = {
$segments
};

static void curve_speeds(int n, const ca_real *thrusts, const ca_real *thrust_coefficient,
    const ca_real *reverse_coefficient, const ca_real *low, const ca_real *high, ca_real *speeds)
{
    (void)reverse_coefficient; /* rotors with a curve do not reverse */
    for (int i = 0; i < n; i++) {
        const ca_real f = (thrusts[i] > 0 ? thrusts[i] : 0) / thrust_coefficient[i];
        int k = $count - 1;
        while (k > 0 && f < levels[k])
            k--;
        const ca_real a = segments[k][1], b = segments[k][2], rest = f - segments[k][3];
        const ca_real square = b * b + 4 * a * rest;
        const ca_real s = ca_sqrt(square > 0 ? square : 0);
        const ca_real top = b >= 0 ? 2 * rest : s - b, bottom = b >= 0 ? b + s : 2 * a;
        speeds[i] = ca_clip(bottom > 0 || bottom < 0 ? top / bottom : 0, low[i], high[i]);
    }
}


/* `ca_narrow` for the thrust curve. */
static void curve_narrow(ca_problem *problem, const ca_real *speeds, ca_real time,
    const ca_real *up, const ca_real *down, const ca_real *thrust_coefficient,
    const ca_real *reverse_coefficient, const ca_real *low, const ca_real *high, ca_real *least,
    ca_real *greatest)
{
    const ca_real *last = segments[$count - 1];
    ca_real lower[CA_N], upper[CA_N];
    (void)reverse_coefficient;
    ca_reach(CA_N, speeds, time, up, down, low, high, least, greatest);
    for (int i = 0; i < CA_N; i++) {
        const ca_real k = thrust_coefficient[i], from = least[i], to = greatest[i];
        /* Most speeds are in the last segment. */
        const int within = from >= last[0];
        lower[i] = k * (within ? (last[1] * from + last[2]) * from + last[3]
                               : ca_curve($count, segments, from));
        upper[i] = k * (within ? (last[1] * to + last[2]) * to + last[3]
                               : ca_curve($count, segments, to));
    }
    ca_set_bounds(problem, lower, upper);
}


$points
void ${name}_throttles(const ca_real speeds[${NAME}_ROTORS], ca_real throttles[${NAME}_ROTORS],
    ca_real pulses[${NAME}_ROTORS])
{
    for (int i = 0; i < CA_N; i++) {
        const ca_real w = ca_abs(speeds[i]);
$body
        throttles[i] = speeds[i] < 0 ? -found : found;
        pulses[i] = $low + $range * (speed_min[0][i] < 0 ? $half + $half * throttles[i] : throttles[i]);
    }
}

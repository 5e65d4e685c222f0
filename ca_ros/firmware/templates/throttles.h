/* Throttles, from 0 to 1 (from -1 for rotors that reverse), and pulse widths [us] of speeds [rad/s],
 * by the thrust curve at the nominal voltage of the vehicle's file. */
void ${name}_throttles(const ca_real speeds[${NAME}_ROTORS], ca_real throttles[${NAME}_ROTORS],
    ca_real pulses[${NAME}_ROTORS]);


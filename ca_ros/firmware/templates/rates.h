/* Time since the last call that counts at most [s]. */
#define ${NAME}_TIME_MAX $time

/* The same within what the rotors reach at their rates from their speeds, `time` [s] after these.
 * `speeds` are those of the last command, and become those of this one. If bounds that the rates move
 * limit the answer, it is CA_RATE_LIMITED. The bounds need no new set-up. The function has a copy of
 * the problem, so that two tasks must not call it at once; the answer depends on no earlier call. */
int ${name}_allocate_within(int fault, const ca_real wrench[${NAME}_AXES], ca_real time,
    ca_real speeds[${NAME}_ROTORS]);


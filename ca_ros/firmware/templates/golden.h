/* Golden vectors of the vehicle $name: wrenches, and what the same kernel answered on the machine
 * that wrote this file. The first wrenches of each fault are attainable, the next are on the boundary of
 * the admissible set, the next beyond it; the last are special. */
#include <math.h>

#include "$name.h"

#define VEHICLE "$name"
#define ALLOCATE ${name}_allocate
#define COMMANDS $commands
$margin_function
${rates_golden}${throttles_golden}static const struct {
    int fault;
    ca_real wrench[CA_M];
    int status;
    ca_real speeds[COMMANDS];
$margin_field} golden[] = {
$vectors
};

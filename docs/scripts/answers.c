/* Read wrenches from stdin, and write the status and the speeds of each to stdout, as binary numbers.
 * Define VEHICLE as the header of an export, and ALLOCATE as its function. */
#include <stdio.h>

#include VEHICLE

int main(void)
{
    struct {
        int fault;
        ca_real wrench[CA_M];
    } given;
    struct {
        int status;
        ca_real speeds[CA_N];
    } found;
    while (fread(&given, sizeof given, 1, stdin) == 1) {
        found.status = ALLOCATE(given.fault, given.wrench, found.speeds);
        fwrite(&found, sizeof found, 1, stdout);
    }
    return 0;
}

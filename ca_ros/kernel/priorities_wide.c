/* The priorities in double precision, for problems in single precision; see priorities.c. */
#include "problem.h"

#ifdef CA_FLOAT
#define CA_WIDE
#include "priorities.c"
#else
typedef int ca_no_wide_priorities; /* no file is empty in C */
#endif

/* The clipped pseudo-inverse and OSQP's generated code, for the vehicle and precision of data.h.
 *
 * A method writes thrusts[CA_N] for u[CA_M]; it returns 1, or 0 if it has no answer.
 */
#include "data.h"

int clipped_pinv(const number *u, number *thrusts)
{
    for (int i = 0; i < CA_N; i++) {
        number sum = 0;
        for (int k = 0; k < CA_M; k++)
            sum += inverse[i][k] * u[k];
        sum = sum < lower[i] ? lower[i] : sum;
        thrusts[i] = sum > upper[i] ? upper[i] : sum;
    }
    return 1;
}

#ifdef WITH_OSQP
#include "osqp.h"
#include "workspace.h"

int osqp(const number *u, number *thrusts)
{
    number low[CA_M + CA_N], high[CA_M + CA_N];
    for (int k = 0; k < CA_M; k++)
        low[k] = high[k] = u[k];
    for (int i = 0; i < CA_N; i++) {
        low[CA_M + i] = lower[i];
        high[CA_M + i] = upper[i];
    }
    osqp_update_data_vec(&solver, 0, low, high);
    osqp_solve(&solver);
    for (int i = 0; i < CA_N; i++)
        thrusts[i] = solver.solution->x[i];
    return solver.info->status_val == OSQP_SOLVED;
}
#endif

/* A flight for the page: a rigid body and the controller of ca_ros in a closed loop with an allocator.
 *
 * The steps are those of `ca_ros.simulation.closed_loop.fly` without wind, noise and lag. The
 * allocator gets the demand of the controller, attainable or not. World east-north-up, body
 * forward-left-up. */
#include "binding.c"

#include <math.h> /* for atan2 */

#define LIFT_MIN 0.3          /* least vertical force over the weight */
#define HEADING_ERROR_MAX 0.5 /* [rad] */
#define PERIOD_MAX 0.1        /* greatest time since the last command that counts [s] */
#define STATE_MAX 1e9
#define PI 3.14159265358979323846

/* What the page writes: the body, its controller, and the goal. */
FIELD(ca_real, effect, [6 * CA_N]) /* force [N] and torque [N m] per N of each rotor */
FIELD(int, failed, [CA_N])         /* rotors without thrust, whatever the allocator believes */
FIELD(ca_real, mass, ) FIELD(ca_real, burden, ) /* weight less buoyancy [N] */
FIELD(ca_real, inertia, [9]) FIELD(ca_real, inverse_inertia, [9])
FIELD(ca_real, position_stiffness, [3]) FIELD(ca_real, position_damping, [3])
FIELD(ca_real, attitude_stiffness, [3]) FIELD(ca_real, attitude_damping, [3])
FIELD(ca_real, approach_max, ) FIELD(ca_real, tilt_tangent, )
FIELD(int, leveling, ) FIELD(int, has_rates, )
FIELD(ca_real, goal, [4]) /* x, y, z, heading */
FIELD(ca_real, time_step, )

/* Position, velocity (world), attitude x, y, z, w, angular velocity (body), and the command. */
FIELD(ca_real, state, [13]) FIELD(ca_real, command, [CA_N])

static void turn(const ca_real *matrix, const ca_real *vector, ca_real *result)
{
    for (int k = 0; k < 3; k++)
        result[k] = ca_dot(3, &matrix[3 * k], vector);
}

static void cross(const ca_real *a, const ca_real *b, ca_real *result)
{
    for (int k = 0; k < 3; k++)
        result[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

/* The matrix from body to world coordinates, and its transpose. */
static void find_rotation(ca_real *rotation, ca_real *back)
{
    const ca_real length = ca_length(4, &state[6]);
    const ca_real x = state[6] / length, y = state[7] / length, z = state[8] / length,
                  w = state[9] / length;
    const ca_real matrix[] = {
        1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
        2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
        2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)};
    ca_copy(9, matrix, rotation);
    for (int k = 0; k < 9; k++)
        back[k] = matrix[k % 3 * 3 + k / 3];
}

/* The wanted force in the world frame [N]. */
static void find_force(ca_real *force)
{
    for (int k = 0; k < 3; k++) {
        const ca_real approach = position_stiffness[k] / position_damping[k] * (goal[k] - state[k]);
        force[k] = mass * position_damping[k] *
                   (ca_clip(approach, -approach_max, approach_max) - state[3 + k]);
    }
    force[2] += burden;
    if (leveling)
        return;
    force[2] = ca_max(force[2], LIFT_MIN * burden);
    const ca_real sideways = ca_length(2, force), allowed = tilt_tangent * force[2];
    for (int k = 0; k < 2 && sideways > allowed; k++)
        force[k] *= allowed / sideways;
}

/* The rotation about x and y that takes the body's z axis to a direction [rad], and about z the
 * limited rotation to the goal's heading. */
static void find_error(const ca_real *back, const ca_real *direction, ca_real *error)
{
    const ca_real z = state[9] < 0 ? -state[8] : state[8];
    ca_real body[3], off = goal[3] - 2 * atan2(z, ca_abs(state[9]));
    turn(back, direction, body);
    const ca_real sine = ca_length(2, body), angle = atan2(sine, body[2]);
    error[0] = sine > 0 ? -body[1] * angle / sine : angle;
    error[1] = sine > 0 ? body[0] * angle / sine : 0;
    while (off >= PI)
        off -= 2 * PI;
    while (off < -PI)
        off += 2 * PI;
    error[2] = ca_clip(off, -HEADING_ERROR_MAX, HEADING_ERROR_MAX);
}

/* The controller: a PD action on the position gives the force, one on the attitude the torque. */
static void find_demand(void)
{
    static const ca_real up[] = {0, 0, 1};
    ca_real rotation[9], back[9], force[3], error[3], acceleration_wanted[3], momentum[3], wrench[6];
    const ca_real *omega = &state[10], carried[] = {omega[2] * omega[1], -omega[2] * omega[0], 0};
    find_rotation(rotation, back);
    find_force(force);
    find_error(back, leveling ? up : force, error);
    for (int k = 0; k < 3; k++)
        acceleration_wanted[k] =
            attitude_stiffness[k] * error[k] - attitude_damping[k] * omega[k] + carried[k];
    turn(back, force, wrench);
    turn(inertia, omega, momentum);
    cross(omega, momentum, error);
    turn(inertia, acceleration_wanted, &wrench[3]);
    for (int k = 0; k < m; k++)
        demand[k] = wrench[axis[k]] + (axis[k] > 2 ? error[axis[k] - 3] : 0);
}

/* Allocate the demand within what the rotors reach from the last command in a time. */
static void find_command(int method, ca_real time)
{
    ca_real least[CA_N], most[CA_N], widest[CA_N], narrowest[CA_N];
    ca_copy(n, lower, narrowest);
    ca_copy(n, upper, widest);
    if (has_rates && m) {
        ca_reach(n, command, time, acceleration, deceleration, speed_min, speed_max, least, most);
        thrusts_of(least, lower);
        thrusts_of(most, upper);
        ca_set_bounds(&problem, lower, upper);
    }
    answer(method);
    ca_copy(n, narrowest, lower);
    ca_copy(n, widest, upper);
    ca_copy(n, speeds, command);
}

/* Take an explicit Euler step with the command; returns 0 if the vehicle tumbles too fast for it. */
static int move(void)
{
    ca_real rotation[9], back[9], force[6] = {0}, lift[CA_N], rate[13], torque[3], momentum[3];
    const ca_real x = state[6], y = state[7], z = state[8], w = state[9], *omega = &state[10];
    const ca_real turning[] = {w, -z, y, z, w, -x, -y, x, w, -x, -y, -z};
    thrusts_of(command, lift);
    for (int i = 0; i < n; i++)
        for (int k = 0; k < 6 && !failed[i]; k++)
            force[k] += effect[k * n + i] * lift[i];
    find_rotation(rotation, back);
    turn(inertia, omega, momentum);
    cross(omega, momentum, torque);
    ca_copy(3, &state[3], rate);
    turn(rotation, force, &rate[3]);
    for (int k = 0; k < 3; k++) {
        rate[3 + k] = rate[3 + k] / mass - (k == 2 ? burden / mass : 0);
        torque[k] = force[3 + k] - torque[k];
    }
    for (int k = 0; k < 4; k++)
        rate[6 + k] = ca_dot(3, &turning[3 * k], omega) / 2;
    turn(inverse_inertia, torque, &rate[10]);
    for (int k = 0; k < 13; k++)
        state[k] += time_step * rate[k];
    const ca_real length = ca_length(4, &state[6]);
    for (int k = 6; k < 10; k++)
        state[k] /= length;
    for (int k = 0; k < 13; k++)
        if (!(ca_abs(state[k]) < STATE_MAX))
            return 0;
    return 1;
}

/* Fly some steps with a method; returns how many were possible. `started` is 0 before the first. */
SHARED int fly(int method, int steps, int started)
{
    for (int step = 0; step < steps; step++) {
        find_demand();
        find_command(method, started || step ? time_step : PERIOD_MAX);
        if (!move())
            return step;
    }
    return steps;
}

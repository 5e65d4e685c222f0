/* The detector of rotor failures: states and commanded rotor speeds in, the health of the rotors out.
 * The method is that of ca_ros/detection: FailureDetector and what it consists of. */
#ifndef CA_ROS_KERNEL_DETECTOR_H
#define CA_ROS_KERNEL_DETECTOR_H

#include <stdint.h>

#include "problem.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Greatest number of commands that wait for the end of the delay; of more, the oldest are dropped. */
#ifndef CA_COMMANDS
#define CA_COMMANDS 100
#endif

/* Greatest number of segments of the thrust curve. */
#ifndef CA_SEGMENTS
#define CA_SEGMENTS 64
#endif

#define CA_STATE_MAX ((ca_real)1e9) /* greatest number of a state */
#define CA_TIME_MAX (INT64_C(1) << 62) /* times are less, before and after zero [ns] */

/* Flights that do not begin at rest are not tested for so long [s]. */
#define CA_UNTESTED ((ca_real)0.295)

#define CA_BLOCKS 34 /* blocks of time that are kept */
#define CA_WINDOWS 5 /* windows of time that are tested */

/* A vehicle and its detector's settings. It is constant data, and may be in flash.
 * X(name, dimensions); body frame x forward, y left, z up */
#define CA_DETECTOR_FIELDS(X) \
    X(rotors, )                /* number of rotors, at most CA_N */ \
    X(mass, )                  /* [kg] */ \
    X(weight, )                /* m g less the buoyancy [N] */ \
    X(inertia, [3][3])         /* [kg m^2] */ \
    X(wrenches, [6][CA_N])     /* force and torque per thrust of each rotor */ \
    X(segments, )              /* number of segments of the thrust curve */ \
    X(curve, [CA_SEGMENTS][4]) /* start w [rad/s], a, b, c of each: thrust a w^2 + b w + c [N] */ \
    X(least, [CA_N])           /* speed of each motor [rad/s] */ \
    X(greatest, [CA_N])        /* the same */ \
    X(thrust, [CA_N])          /* of each sound rotor over that of the curve */ \
    X(reverse_thrust, [CA_N])  /* of one that turns backwards over its squared speed [kg m] */ \
    X(health, [CA_N])          /* what is announced of each rotor */ \
    X(time_constant, )         /* of the motors [s] */ \
    X(delay, )                 /* of the motors [s] */ \
    X(arms, [3][CA_N])         /* of the rotors [m] */ \
    X(partner, [CA_N])         /* the other rotor of a coaxial pair, counted from 0, or -1 */ \
    X(unit, [6])               /* squared wrench of a thrust of 1 N in any direction */ \
    X(disturbance, [2][6])     /* variances of a push of a rotor's size and a contact [N^2, N^2 m^2] */ \
    X(gravity, )               /* m g [N] */ \
    X(imu, [3])                /* place of the accelerometer [m] */ \
    X(lever, )                 /* least lever of two failed rotors [m] */ \
    X(force_noise, )           /* variance of an impulse by the accelerometer, in a second */ \
    X(noise, [6])              /* variance of an impulse by the noise of the states */ \
    X(moving, [6])             /* motion of a vehicle that moves [m/s, rad/s] */ \
    X(jump, [6])               /* greatest jump of the momentum [kg m/s, kg m^2/s] */ \
    X(balance, [4])            /* imbalance of vertical force and torque of one that stands */

#define CA_DETECTOR_MEMBER(name, dimensions) ca_real name dimensions;
typedef struct {
    CA_DETECTOR_FIELDS(CA_DETECTOR_MEMBER)
} ca_detector_model;
#undef CA_DETECTOR_MEMBER

enum ca_evidence { CA_NONE = 0, CA_MOTION = 1, CA_ROTOR_SPEED = 2 };

/* The sums over a block, or a window, of time. */
typedef struct {
    ca_real length;        /* [s] */
    ca_real impulse[6];    /* that nothing explains, in the body frame [N s, N m s] */
    ca_real lateral[2];    /* integral of the drag along x and y [N s] */
    ca_real total;         /* sum of `given`, each positive [N s] */
    ca_real given[CA_N];   /* integral of the thrust of each sound rotor [N s] */
    ca_real change[CA_N];  /* of this thrust [N] */
} ca_block;

/* All memory of a detector. The first part is for reading. */
typedef struct {
    ca_real health[CA_N];    /* the announced one less what was found */
    ca_real probabilities[CA_N + 1]; /* that each rotor has failed, and of a disturbance */
    int64_t since[CA_N];     /* when each failure was found [ns] */
    int evidence[CA_N];      /* what it was found by: an enum ca_evidence */
    int order[CA_N];         /* the number of its name, shared in one test; 0: none */
    int suspect;             /* the rotor that may be failing now, counted from 0, or -1 */
    int standing;            /* whether the vehicle stands: then nothing is detected */

    const ca_detector_model *model;
    ca_real announced[CA_N];
    /* commanded rotors */
    int waiting, has_command;
    int64_t commanded;
    int64_t due[CA_COMMANDS];
    ca_real commands[CA_COMMANDS][CA_N];
    ca_real command[CA_N], speeds[CA_N];
    int known; /* whether the speeds followed the commands in the last step */
    int64_t in_force, unsettled; /* when the last one took effect, and time until the speeds are
                                    known [ns] */
    /* measured rotors */
    ca_real measured[CA_N], least[3][CA_N];
    int64_t interval;
    int slow[CA_N];
    /* momentum observer */
    int timed, doubted, interrupted, measures_force;
    int64_t time, doubtful;
    ca_real momentum[6], wrench[6], estimate[6], before[6], latest[6];
    ca_real kept, still, mean_motion[6], lacked[6];
    /* the last state, and what is learnt */
    ca_real rotation[3][3], motion[6];
    ca_real learnt[6], moments[4][6], drag[6], variance[2][CA_WINDOWS][6], mean_thrusts[CA_N];
    /* the test */
    int64_t blind; /* time until the speeds of the motors are known [ns] */
    int rested;    /* whether the flight has begun at rest, and its trim is known */
    ca_real flown, waited, unlearnt, refined[CA_N];
    ca_real leads[CA_N];     /* of each rotor over all else, gathered while it is suspected */
    int named[4], open[4], names, count, windows[CA_WINDOWS];
    int arm[CA_N], upper[CA_N]; /* 1 for both of a named arm; tests in a row for one of the two */
    ca_real thrusts[CA_N], peaks[CA_N]; /* the last ones, and the greatest of about a second */
    int newest;
    ca_block sums, blocks[CA_BLOCKS]; /* a ring */
} ca_detector;

/* Begin, with all memory as at the start; the model must outlive the detector. */
void CA_SYMBOL(ca_detector_start)(ca_detector *detector, const ca_detector_model *model);
#define ca_detector_start CA_SYMBOL(ca_detector_start)

/* Forget all failures, and what was learnt of the noise. */
void CA_SYMBOL(ca_detector_reset)(ca_detector *detector);
#define ca_detector_reset CA_SYMBOL(ca_detector_reset)

/* Take the next state as one that does not continue those before; what was found holds. */
void CA_SYMBOL(ca_detector_interrupt)(ca_detector *detector);
#define ca_detector_interrupt CA_SYMBOL(ca_detector_interrupt)

/* The following functions return -1, and have changed nothing, if a number is not finite or out of
 * bounds. */

/* Take the announced health, from 0 to 1, which replaces the one before; what was found holds.
   Return 0. */
int CA_SYMBOL(ca_detector_announce)(ca_detector *detector, const ca_real *health);
#define ca_detector_announce CA_SYMBOL(ca_detector_announce)

/* Take commanded rotor speeds [rad/s] with their stamp [ns]. Motors are at their bounds for speeds
 * beyond these. A command that is newer than the last state by two seconds is ignored. Return 0. */
int CA_SYMBOL(ca_detector_command)(ca_detector *detector, int64_t time, const ca_real *speeds);
#define ca_detector_command CA_SYMBOL(ca_detector_command)

/* Take measured rotor speeds [rad/s]; return whether the health has changed. Those that are older
 * than the last command by more than 0.1 s with lag and delay are ignored. */
int CA_SYMBOL(ca_detector_measure)(ca_detector *detector, int64_t time, const ca_real *speeds);
#define ca_detector_measure CA_SYMBOL(ca_detector_measure)

/* Take a state; return whether the health has changed.
 *
 * time      [ns]
 * attitude  quaternion x, y, z, w, body to world (z up), of a length of at least 1e-9
 * motion    velocity before angular velocity in the body frame, up to 1e9 [m/s, rad/s]
 * specific_force  of the accelerometer, in the mean since the last state, in the body frame [m/s^2];
 *                 null where there is none
 */
int CA_SYMBOL(ca_detector_observe)(ca_detector *detector, int64_t time, const ca_real attitude[4],
                                   const ca_real motion[6], const ca_real *specific_force);
#define ca_detector_observe CA_SYMBOL(ca_detector_observe)

#ifdef __cplusplus
}
#endif

#endif

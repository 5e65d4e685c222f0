/* A multirotor in wind and on the ground, with sensors, and a controller of its own.
 *
 * It flies hours for the detector of failures, and was written without knowledge of the detector.
 * Frames as in the package: body forward-left-up, world east-north-up, quaternions x, y, z, w from
 * body to world.  All rotors thrust along the z axis of the body.  SI units.
 *
 * Rotors: first-order lag of the speed; uniform inflow with a lag (momentum theory, Glauert in
 * forward flight); drag in the plane of the rotor and hub moments of flapping; the wake of the
 * rotors upwind and of the upper rotor of a coaxial pair; ground effect (Cheeseman and Bennett).
 * Air: wind, and Dryden turbulence at low altitude (MIL-F-8785C).  Legs: springs, dampers, friction.
 */
#include <math.h>
#include <stdint.h>
#include <string.h>

enum { ROTORS = 8, FEET = 4, HISTORY = 64 };
enum { AIRBORNE, GROUNDED, CLIMBING, HOLDING, DESCENDING, SHUTTING };
enum { NO_FAILURE, LOSS, FADE, STUCK };

static const double STEP = 1.25e-3;      /* of the rigid body [s] */
static const double DENSITY = 1.225;     /* of air [kg/m^3] */
static const double PI = 3.14159265358979323846;
static const int PER_CONTROL = 8;        /* steps between two states, without jitter */
static const int PER_GUST = 4;           /* steps between two updates of the turbulence */
static const double FADING = 2.0;        /* duration of a fade [s] */

/* What the controller believes of the vehicle. */
struct vehicle {
    double n, mass, gravity, inertia[3], position[ROTORS][3], spin[ROTORS];
    double thrust, torque;               /* k_f, k_tau, of all rotors [kg m, kg m^2] */
    double slowest, fastest;             /* bounds of the speed [rad/s] */
    double radius;                       /* of a rotor [m] */
    double foot, height;                 /* distance of the feet from the z axis, and below [m] */
    double inverse[ROTORS][4];           /* pseudo-inverse of the allocation matrix */
};

/* What is true, or differs from what is believed. */
struct truth {
    double mass_factor, inertia_factor[3], centre[3];  /* centre of mass [m] */
    double thrust_factor[ROTORS], torque_factor[ROTORS];
    double lag[ROTORS], braking;         /* time constants [s]; factor of that of slowing down */
    double delay, age, jitter;           /* of a command and a state [s]; range of both, +- [s] */
    double sag, sag_rate, sag_load;      /* share of speed: at the start, each second, in hover */
    double flapping, hub_moment;         /* drag [N s^2/(rad m)]; moment over T R mu */
    double inflow, wake, coaxial;        /* shares, see `rotor_forces` */
    double rotor_inertia;                /* [kg m^2] */
    double body_drag, pressure[3];       /* C_d A [m^2]; centre of pressure [m] */
    double ground_effect;                /* factor of the term of Cheeseman and Bennett */
    double sink, damping, friction;      /* of the legs: deflection at rest [m], ratio, mu */
    double uneven[FEET];                 /* how much each leg is longer [m] */
    double wind[3], turbulence;          /* [m/s]; wind speed at 6 m that sets intensities [m/s] */
    double payload, hook[3], dropped;    /* mass [kg], where it hangs [m], when it is dropped [s] */
    double position_noise, velocity_noise, attitude_noise, rate_noise;
    double force_noise, force_bias[3], imu[3], vibration;  /* [m/s^2]; place of the IMU [m] */
};

/* What is flown. */
struct mission {
    double speed, acceleration, tilt;    /* limits [m/s, m/s^2, rad] */
    double ahead;                        /* share of the acceleration that is fed forward */
    double stiffness;                    /* factor of the gains of attitude and rates */
    double reach, low, high;             /* waypoints: half the side of a square, heights [m] */
    double shortest, longest;            /* time between waypoints [s] */
    double turn;                         /* greatest rate of the reference of yaw [rad/s] */
    double period;                       /* from a take-off to the next [s]; 0: no landings */
    double pushes, push;                 /* time between pushes [s], 0: none; force [N] */
    double briefest, lasting;            /* the least and the greatest length of a push [s] */
    double failure, rotor, left;         /* kind; from 0; thrust that is left */
    double time;                         /* not before [s], with landings since a take-off */
};

/* A state as it was measured, the command that answers it, and what was true. */
struct row {
    int64_t time;                        /* [ns] */
    double attitude[4], velocity[3], rates[3], specific_force[3];  /* measured, velocity in body */
    double command[ROTORS];              /* [rad/s] */
    double position[3], speeds[ROTORS], wind[3];  /* true; wind with its gusts */
    double feet, mode, pushed, failed;   /* feet on the ground; others 0 or 1 */
};

struct sample {
    double p[3], v[3], q[4], w[3], force[3], turning[3], phase[ROTORS];
};

struct plant {
    struct vehicle vehicle;
    struct truth truth;
    struct mission mission;
    uint64_t random[4];
    double spare;
    int has_spare;

    long step, gusted, next_control;
    double p[3], v[3], q[4], w[3];       /* position, velocity (world), attitude, rates (body) */
    double speed[ROTORS], induced[ROTORS], phase[ROTORS], share[ROTORS], bladed[ROTORS];
    double mass, inertia[3], centre[3];
    int upper[ROTORS];                   /* the rotor above, or -1 */
    double rise[ROTORS], fall[ROTORS];   /* shares of a step's change of speed */
    double gust[3], swirl[3], filter[5];
    double load;                         /* thrust over weight, smoothed */
    int touching, stuck, failed, gone;
    double failed_at, lifted;            /* when it failed, when the last foot left the ground */
    double push[3], push_at[3], push_begin, push_end, push_next;

    struct sample past[HISTORY];
    double target[ROTORS];               /* command that has arrived at the motors */
    struct { long due; double command[ROTORS]; } queue[HISTORY];
    int first, waiting;

    int mode;
    double patience;                     /* from standing still to the end of a landing [s] */
    double since, goal[3], heading, goal_heading, reference[3], next_goal, next_hop, rate;
    double integral[3], spun[3], feed[3], still, spool;
    double measured_p[3], measured_v[3], measured_q[4], measured_w[3];
};

/* xoshiro256** (Blackman and Vigna), seeded by splitmix64. */
static uint64_t next(struct plant *a) {
    uint64_t *s = a->random, x = s[1] * 5, t = s[1] << 17;
    uint64_t result = ((x << 7) | (x >> 57)) * 9;
    s[2] ^= s[0]; s[3] ^= s[1]; s[1] ^= s[2]; s[0] ^= s[3]; s[2] ^= t;
    s[3] = (s[3] << 45) | (s[3] >> 19);
    return result;
}

static double uniform(struct plant *a, double low, double high) {
    return low + (high - low) * ((double)(next(a) >> 11) * 0x1p-53);
}

/* Polar method of Marsaglia. */
static double normal(struct plant *a) {
    double x, y, s;
    if (a->has_spare) {
        a->has_spare = 0;
        return a->spare;
    }
    do {
        x = uniform(a, -1.0, 1.0);
        y = uniform(a, -1.0, 1.0);
        s = x * x + y * y;
    } while (s >= 1.0 || s == 0.0);
    s = sqrt(-2.0 * log(s) / s);
    a->spare = y * s;
    a->has_spare = 1;
    return x * s;
}

static double clip(double x, double low, double high) { return x < low ? low : x > high ? high : x; }

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static double norm(const double a[3]) { return sqrt(dot(a, a)); }

static void cross(const double a[3], const double b[3], double c[3]) {
    double x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
    c[0] = x;
    c[1] = y;
}

static void matrix(const double q[4], double r[3][3]) {
    double x = q[0], y = q[1], z = q[2], w = q[3];
    r[0][0] = 1.0 - 2.0 * (y * y + z * z);
    r[0][1] = 2.0 * (x * y - w * z);
    r[0][2] = 2.0 * (x * z + w * y);
    r[1][0] = 2.0 * (x * y + w * z);
    r[1][1] = 1.0 - 2.0 * (x * x + z * z);
    r[1][2] = 2.0 * (y * z - w * x);
    r[2][0] = 2.0 * (x * z - w * y);
    r[2][1] = 2.0 * (y * z + w * x);
    r[2][2] = 1.0 - 2.0 * (x * x + y * y);
}

static void to_world(double r[3][3], const double a[3], double b[3]) {
    for (int i = 0; i < 3; i++) b[i] = r[i][0] * a[0] + r[i][1] * a[1] + r[i][2] * a[2];
}

static void to_body(double r[3][3], const double a[3], double b[3]) {
    for (int i = 0; i < 3; i++) b[i] = r[0][i] * a[0] + r[1][i] * a[1] + r[2][i] * a[2];
}

/* Turn q by a rotation vector in the body frame, and normalise it. */
static void turn(double q[4], const double angle[3]) {
    double square = dot(angle, angle), half = sqrt(square) / 2.0;
    double s = square > 1e-12 ? sin(half) / (2.0 * half) : 0.5, c = cos(half);
    double x = s * angle[0], y = s * angle[1], z = s * angle[2];
    double old[4] = {q[0], q[1], q[2], q[3]};
    q[0] = old[3] * x + old[0] * c + old[1] * z - old[2] * y;
    q[1] = old[3] * y + old[1] * c + old[2] * x - old[0] * z;
    q[2] = old[3] * z + old[2] * c + old[0] * y - old[1] * x;
    q[3] = old[3] * c - old[0] * x - old[1] * y - old[2] * z;
    double scale = 1.0 / sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    for (int i = 0; i < 4; i++) q[i] *= scale;
}

static double now(const struct plant *a) { return (double)a->step * STEP; }

/* ---- air ---- */

/* Dryden turbulence along wind, across, and up, and the roll, pitch of the air over the span. */
static void blow(struct plant *a) {
    const struct truth *t = &a->truth;
    double dt = STEP * PER_GUST, feet = clip(a->p[2], 2.0, 10.0) / 0.3048;
    double shape = 0.177 + 0.000823 * feet;
    double sigma_w = 0.1 * t->turbulence, sigma_u = sigma_w / pow(shape, 0.4);
    double length_w = 0.3048 * feet, length_u = length_w / pow(shape, 1.2);
    double air[3], span = 2.0 * norm(a->vehicle.position[0]) + 2.0 * a->vehicle.radius;
    for (int i = 0; i < 3; i++) air[i] = a->v[i] - t->wind[i];
    double speed = fmax(norm(air), 1.0);

    double keep = exp(-dt * speed / length_u);
    a->filter[0] = keep * a->filter[0] + sqrt(1.0 - keep * keep) * normal(a);
    double found[3] = {sigma_u * a->filter[0], 0.0, 0.0};
    for (int i = 1; i < 3; i++) {  /* K (1 + sqrt(3) T s) / (1 + T s)^2, of unit variance */
        double *p = &a->filter[2 * i - 1], *q = p + 1, old = *p;
        keep = exp(-dt * speed / (i == 1 ? length_u : length_w));
        *p = keep * old + sqrt((1.0 - keep * keep) / 2.0) * normal(a);
        *q = keep * *q + (1.0 - keep) * (old + *p) / 2.0;
        found[i] = (i == 1 ? sigma_u : sigma_w) * (sqrt(3.0) * *p + (1.0 - sqrt(3.0)) * *q);
    }
    double angle = atan2(t->wind[1], t->wind[0]), c = cos(angle), s = sin(angle);
    a->gust[0] = c * found[0] - s * found[1];
    a->gust[1] = s * found[0] + c * found[1];
    a->gust[2] = found[2];

    double cutoff = PI * speed / (4.0 * span);
    double variance = 0.8 * sigma_w * sigma_w / length_w
        * pow(PI * length_w / (4.0 * span), 1.0 / 3.0) * (PI / 2.0) * (PI / (4.0 * span));
    keep = exp(-dt * cutoff);
    for (int i = 0; i < 3; i++)
        a->swirl[i] = keep * a->swirl[i] + sqrt(variance * (1.0 - keep * keep)) * normal(a);
}

/* ---- rotors ---- */

static void spin_up(struct plant *a) {
    const struct truth *t = &a->truth;
    double lost = clip(t->sag + t->sag_rate * now(a) + t->sag_load * (a->load - 1.0), 0.0, 0.3);
    for (int i = 0; i < (int)a->vehicle.n; i++) {
        double change = a->target[i] * (1.0 - lost) - a->speed[i];
        if (!(a->stuck && i == (int)a->mission.rotor))
            a->speed[i] += (change > 0.0 ? a->rise[i] : a->fall[i]) * change;
        a->phase[i] = fmod(a->phase[i] + STEP * a->speed[i], 2.0 * PI);
    }
}

/* Add the forces and torques of the rotors in the body frame.
 *
 * T = k_f s^2 (1 + inflow (1 - (v + V) / v_0)): v is the induced velocity, V that of the climb
 * through the air, v_0 the induced velocity at the speed s in still air.  v follows
 * T / (2 rho A U) with the time constant 0.212 R / U; U is the speed of the air at the disk.
 */
static void rotor_forces(struct plant *a, double r[3][3], double force[3], double torque[3]) {
    const struct vehicle *vehicle = &a->vehicle;
    const struct truth *t = &a->truth;
    double area = PI * vehicle->radius * vehicle->radius, air[3], world[3], swirl[3], total = 0.0;
    double arm = norm(vehicle->position[0]);
    for (int i = 0; i < 3; i++) world[i] = a->v[i] - t->wind[i] - a->gust[i];
    to_body(r, world, air);
    for (int i = 0; i < 3; i++) swirl[i] = a->w[i] - a->swirl[i];
    for (int i = 0; i < (int)vehicle->n; i++) {
        double place[3], hub[3], s = a->speed[i], k = vehicle->thrust * t->thrust_factor[i];
        for (int j = 0; j < 3; j++) place[j] = vehicle->position[i][j] - a->centre[j];
        cross(swirl, place, hub);
        for (int j = 0; j < 3; j++) hub[j] += air[j];
        double across = sqrt(hub[0] * hub[0] + hub[1] * hub[1]), ratio = 1.0;
        if (t->inflow > 0.0 && s > 20.0) {
            double still = s * sqrt(k / (2.0 * DENSITY * area)), v = a->induced[i];
            double through = v + hub[2];
            if (across > 1e-6)  /* upwash ahead, downwash behind */
                through -= t->wake * v * (place[0] * hub[0] + place[1] * hub[1]) / (arm * across)
                    * across / (across + v);
            if (a->upper[i] >= 0) through += t->coaxial * (a->induced[a->upper[i]] - still);
            ratio = clip(1.0 + t->inflow * (1.0 - through / still), 0.0, 2.0);
            double u = sqrt(across * across + (v + hub[2]) * (v + hub[2]));
            u = fmax(u, 0.5 * still);
            double wanted = k * s * s * ratio * a->share[i] / (2.0 * DENSITY * area * u);
            a->induced[i] += clip(STEP * u / (0.212 * vehicle->radius), 0.0, 0.3) * (wanted - v);
        }
        if (t->ground_effect > 0.0) {
            double height = a->p[2] + r[2][0] * place[0] + r[2][1] * place[1] + r[2][2] * place[2];
            double x = vehicle->radius / (4.0 * fmax(height, 0.6 * vehicle->radius));
            ratio *= 1.0 + t->ground_effect * (1.0 / (1.0 - x * x) - 1.0) * fmax(r[2][2], 0.0);
        }
        double f = k * s * s * ratio * a->share[i];
        double drag = t->flapping * s * a->bladed[i];
        double each[3] = {-drag * hub[0], -drag * hub[1], f}, moment[3];
        cross(place, each, moment);
        /* The disk tilts back (-z x V) and, by its sense, to one side. */
        double flap = t->hub_moment * f / fmax(s, 20.0), side = 0.5 * vehicle->spin[i] * flap;
        moment[0] += flap * hub[1] + side * hub[0];
        moment[1] += -flap * hub[0] + side * hub[1];
        moment[2] += vehicle->spin[i] * vehicle->torque * t->torque_factor[i] * s * s * a->share[i];
        for (int j = 0; j < 3; j++) {
            force[j] += each[j];
            torque[j] += moment[j];
        }
        total += f;
    }
    a->load += STEP / 0.3 * (total / (vehicle->mass * vehicle->gravity) - a->load);
    if (t->body_drag > 0.0) {
        double scale = -0.5 * DENSITY * t->body_drag * norm(air), place[3], moment[3];
        double each[3] = {scale * air[0], scale * air[1], scale * air[2]};
        for (int j = 0; j < 3; j++) place[j] = t->pressure[j] - a->centre[j];
        cross(place, each, moment);
        for (int j = 0; j < 3; j++) {
            force[j] += each[j];
            torque[j] += moment[j];
        }
    }
}

/* ---- ground ---- */

/* Add the force (world) and torque (body) of the feet; `touching` counts those that touch. */
static void feet(struct plant *a, double r[3][3], double force[3], double torque[3]) {
    const struct vehicle *vehicle = &a->vehicle;
    const struct truth *t = &a->truth;
    double stiffness = vehicle->mass * vehicle->gravity / (FEET * t->sink);
    double damper = 2.0 * t->damping * sqrt(stiffness * vehicle->mass / FEET);
    a->touching = 0;
    if (a->p[2] > vehicle->height + vehicle->foot) return;
    for (int i = 0; i < FEET; i++) {
        double angle = PI / 4.0 + PI / 2.0 * i, world[3], turning[3], velocity[3];
        double place[3] = {vehicle->foot * cos(angle), vehicle->foot * sin(angle), 0.0};
        place[2] = -vehicle->height - t->uneven[i];
        for (int j = 0; j < 3; j++) place[j] -= a->centre[j];
        to_world(r, place, world);
        double depth = -(a->p[2] + world[2]);
        if (depth <= 0.0) continue;
        cross(a->w, place, turning);
        to_world(r, turning, velocity);
        for (int j = 0; j < 3; j++) velocity[j] += a->v[j];
        double push = fmax(0.0, stiffness * depth - damper * velocity[2]);
        double slip = sqrt(velocity[0] * velocity[0] + velocity[1] * velocity[1]);
        double grip = slip > 1e-9 ? fmin(t->friction * push / slip, damper) : damper;
        double each[3] = {-grip * velocity[0], -grip * velocity[1], push}, own[3], moment[3];
        to_body(r, each, own);
        cross(place, own, moment);
        for (int j = 0; j < 3; j++) {
            force[j] += each[j];
            torque[j] += moment[j];
        }
        a->touching++;
    }
}

/* ---- rigid body ---- */

static void weigh(struct plant *a) {
    const struct truth *t = &a->truth;
    double own = a->vehicle.mass * t->mass_factor, load = a->gone ? 0.0 : t->payload;
    double away[3], square;
    a->mass = own + load;
    for (int i = 0; i < 3; i++) {
        a->centre[i] = (own * t->centre[i] + load * t->hook[i]) / a->mass;
        away[i] = t->hook[i] - t->centre[i];
    }
    square = dot(away, away);
    for (int i = 0; i < 3; i++)
        a->inertia[i] = a->vehicle.inertia[i] * t->inertia_factor[i]
            + own * load / a->mass * (square - away[i] * away[i]);
}

/* Move rotors and air, and add their forces on the body, and those of a push: in the world frame,
 * with their torque in the body frame.  `r` becomes the attitude.
 */
static void forces(struct plant *a, double r[3][3], double force[3], double torque[3]) {
    double body[3] = {0}, lift[3], before[ROTORS];
    const struct mission *m = &a->mission;
    memcpy(before, a->speed, sizeof before);
    while (a->waiting && a->queue[a->first].due <= a->step) {
        memcpy(a->target, a->queue[a->first].command, sizeof a->target);
        a->first = (a->first + 1) % HISTORY;
        a->waiting--;
    }
    if (!a->gone && a->truth.payload > 0.0 && now(a) >= a->truth.dropped) {
        a->gone = 1;
        weigh(a);
    }
    if (a->failed && m->failure == FADE)
        a->share[(int)m->rotor] = fmax(m->left, 1.0 - (now(a) - a->failed_at) / FADING);
    spin_up(a);
    if (a->truth.turbulence > 0.0 && a->step % PER_GUST == 0) blow(a);
    matrix(a->q, r);
    rotor_forces(a, r, body, torque);
    for (int i = 0; i < (int)a->vehicle.n; i++)  /* the reaction to a rotor that speeds up */
        torque[2] += a->vehicle.spin[i] * a->truth.rotor_inertia * (a->speed[i] - before[i]) / STEP;
    if (now(a) >= a->push_begin && now(a) < a->push_end) {
        double own[3], moment[3];
        to_body(r, a->push, own);
        cross(a->push_at, own, moment);
        for (int i = 0; i < 3; i++) {
            force[i] += a->push[i];
            torque[i] += moment[i];
        }
    }
    to_world(r, body, lift);
    for (int i = 0; i < 3; i++) force[i] += lift[i];
}

/* Keep the state after a step, for the sensors. */
static void keep(struct plant *a) {
    struct sample *sample = &a->past[a->step % HISTORY];
    memcpy(sample->p, a->p, sizeof a->p);
    memcpy(sample->v, a->v, sizeof a->v);
    memcpy(sample->q, a->q, sizeof a->q);
    memcpy(sample->w, a->w, sizeof a->w);
    memcpy(sample->phase, a->phase, sizeof a->phase);
    a->step++;
}

static void move(struct plant *a) {
    double r[3][3], torque[3] = {0}, force[3] = {0};
    double acceleration[3], turning[3], spin[3], middle[3], angle[3];
    forces(a, r, force, torque);
    if (a->truth.sink > 0.0) feet(a, r, force, torque);
    for (int i = 0; i < 3; i++) acceleration[i] = force[i] / a->mass;
    struct sample *sample = &a->past[a->step % HISTORY];
    to_body(r, acceleration, sample->force);
    acceleration[2] -= a->vehicle.gravity;
    for (int i = 0; i < 3; i++) spin[i] = a->inertia[i] * a->w[i];
    cross(a->w, spin, turning);
    for (int i = 0; i < 3; i++)
        middle[i] = a->w[i] + STEP / 2.0 * (torque[i] - turning[i]) / a->inertia[i];
    for (int i = 0; i < 3; i++) spin[i] = a->inertia[i] * middle[i];
    cross(middle, spin, turning);
    for (int i = 0; i < 3; i++) {
        sample->turning[i] = (torque[i] - turning[i]) / a->inertia[i];
        angle[i] = STEP * (a->w[i] + STEP / 2.0 * sample->turning[i]);
        a->w[i] += STEP * sample->turning[i];
        a->p[i] += STEP * (a->v[i] + STEP / 2.0 * acceleration[i]);
        a->v[i] += STEP * acceleration[i];
    }
    turn(a->q, angle);
    keep(a);
}

/* ---- sensors ---- */

static long steps(double time) { return lround(time / STEP); }

static void measure(struct plant *a, struct row *row) {
    const struct truth *t = &a->truth;
    double age = t->age + uniform(a, -t->jitter, t->jitter), r[3][3], angle[3], arm[3], more[3];
    long back = steps(fmax(age, 0.0)) + 1;
    if (back > a->step) back = a->step;
    if (back >= HISTORY) back = HISTORY - 1;
    const struct sample *old = &a->past[(a->step - back) % HISTORY];
    matrix(old->q, r);
    to_body(r, old->v, row->velocity);
    memcpy(a->measured_q, old->q, sizeof old->q);
    for (int i = 0; i < 3; i++) {
        angle[i] = t->attitude_noise * normal(a);
        row->velocity[i] += t->velocity_noise * normal(a);
        a->measured_p[i] = old->p[i] + t->position_noise * normal(a);
        a->measured_w[i] = old->w[i] + t->rate_noise * normal(a);
    }
    turn(a->measured_q, angle);
    matrix(a->measured_q, r);
    to_world(r, row->velocity, a->measured_v);

    cross(old->w, t->imu, arm);
    cross(old->w, arm, arm);
    cross(old->turning, t->imu, more);
    for (int i = 0; i < 3; i++)
        row->specific_force[i] = old->force[i] + arm[i] + more[i] + t->force_bias[i]
            + t->force_noise * normal(a);
    if (t->vibration > 0.0) {
        double hover = sqrt(a->vehicle.mass * a->vehicle.gravity
                            / (a->vehicle.n * a->vehicle.thrust));
        for (int i = 0; i < (int)a->vehicle.n; i++) {  /* an unbalance, and the passing blades */
            double size = t->vibration * a->speed[i] * a->speed[i] / (hover * hover);
            size /= sqrt(a->vehicle.n);
            row->specific_force[0] += size * cos(old->phase[i]);
            row->specific_force[1] += size * sin(old->phase[i]);
            row->specific_force[2] += size * cos(2.0 * old->phase[i]);
        }
    }
    memcpy(row->attitude, a->measured_q, sizeof row->attitude);
    memcpy(row->rates, a->measured_w, sizeof row->rates);
    memcpy(row->position, a->p, sizeof row->position);
    memcpy(row->speeds, a->speed, sizeof row->speeds);
    row->time = llround(now(a) * 1e9);
    for (int i = 0; i < 3; i++) row->wind[i] = t->wind[i] + a->gust[i];
    row->feet = a->touching;
    row->mode = a->mode;
    row->pushed = now(a) >= a->push_begin && now(a) < a->push_end;
    row->failed = a->failed;
}

/* ---- mission ---- */

static void enter(struct plant *a, int mode) {
    a->mode = mode;
    a->since = now(a);
}

static void choose(struct plant *a) {
    const struct mission *m = &a->mission;
    double t = now(a);
    if (m->pushes > 0.0 && t >= a->push_next) {
        double size = m->push, direction[3], length;
        do {
            for (int i = 0; i < 3; i++) direction[i] = normal(a);
            length = norm(direction);
        } while (length < 1e-3);
        int where = (int)uniform(a, 0.0, 2.0 * a->vehicle.n);
        for (int i = 0; i < 3; i++) {
            a->push[i] = size * direction[i] / length;
            a->push_at[i] = where < a->vehicle.n ? a->vehicle.position[where][i] : 0.0;
        }
        a->push_begin = t + uniform(a, 0.0, 0.8) * m->pushes;
        a->push_end = a->push_begin + uniform(a, m->briefest, m->lasting);
        a->push_next = t + m->pushes;
    }
    if (m->period > 0.0) {
        switch (a->mode) {
        case GROUNDED:
            if (t >= a->next_hop) {
                a->goal[0] = a->measured_p[0] + uniform(a, -1.0, 1.0);
                a->goal[1] = a->measured_p[1] + uniform(a, -1.0, 1.0);
                a->goal[2] = uniform(a, m->low, m->high);
                a->rate = uniform(a, 0.3, 0.7);
                a->patience = uniform(a, 0.15, 1.0);
                a->next_hop = t + m->period;
                a->spool = 0.0;
                memset(a->integral, 0, sizeof a->integral);
                memset(a->spun, 0, sizeof a->spun);
                enter(a, CLIMBING);
            }
            break;
        case CLIMBING:
            if (fabs(a->measured_p[2] - a->goal[2]) < 0.3 || t > a->since + 5.0) enter(a, HOLDING);
            break;
        case HOLDING:
            if (t > a->next_hop - 4.5 - a->goal[2] / a->rate) enter(a, DESCENDING);
            break;
        case DESCENDING:
            a->still = a->measured_v[2] > -0.3 * a->rate
                && a->measured_p[2] < a->vehicle.height + 0.15 ? a->still + 1.0 : 0.0;
            if (a->still * STEP * PER_CONTROL > a->patience) enter(a, SHUTTING);
            break;
        case SHUTTING:
            if (a->spool <= 0.0) enter(a, GROUNDED);
            break;
        }
    } else if (t >= a->next_goal) {
        a->goal[0] = uniform(a, -m->reach, m->reach);
        a->goal[1] = uniform(a, -m->reach, m->reach);
        a->goal[2] = uniform(a, m->low, m->high);
        if (uniform(a, 0.0, 1.0) < 0.3) a->goal_heading = uniform(a, -PI, PI);
        a->next_goal = t + uniform(a, m->shortest, m->longest);
    }
    int i = (int)m->rotor;
    double asked = a->target[i] * a->target[i] * a->vehicle.thrust * a->vehicle.n;
    if (a->touching || a->mode == GROUNDED) a->lifted = t;
    double since = m->period > 0.0 ? t - a->lifted : t;
    if (m->failure != NO_FAILURE && !a->failed && since >= m->time
            && asked >= 0.5 * a->vehicle.mass * a->vehicle.gravity) {
        a->failed = 1;
        a->failed_at = t;
        a->stuck = m->failure == STUCK;
        if (m->failure == LOSS) {
            a->share[i] = m->left;
            a->bladed[i] = m->left > 0.0;  /* a propeller that is gone has no drag */
        }
    }
}

/* ---- controller ---- */

static const double POSITION_GAIN = 1.1, VELOCITY_GAIN = 2.6, VELOCITY_INTEGRAL = 0.7;
static const double ATTITUDE_GAIN[3] = {4.5, 4.5, 1.4}, RATE_GAIN[3] = {12.0, 12.0, 3.5};
static const double FEED = 0.08;         /* time constant of what is fed forward [s] */
static const double RATE_INTEGRAL[3] = {15.0, 15.0, 2.0};

/* Compute the wrench (thrust, torques) that the mission wants now. */
static void control(struct plant *a, double dt, double wrench[4]) {
    const struct vehicle *vehicle = &a->vehicle;
    const struct mission *m = &a->mission;
    double wanted[3], error[3], r[3][3], up[3], own[3];
    int landing = a->mode == DESCENDING || a->mode == SHUTTING;
    for (int i = 0; i < 3; i++) wanted[i] = POSITION_GAIN * (a->goal[i] - a->measured_p[i]);
    double level = sqrt(wanted[0] * wanted[0] + wanted[1] * wanted[1]);
    double scale = level > m->speed ? m->speed / level : 1.0;
    wanted[0] *= scale;
    wanted[1] *= scale;
    wanted[2] = clip(wanted[2], -fmin(2.0, m->speed), fmin(3.0, m->speed));
    if (a->mode == CLIMBING) wanted[2] = clip(wanted[2], 0.0, 0.8);
    if (landing) wanted[2] = -a->rate;
    for (int i = 0; i < 3; i++) {
        double most = m->acceleration * dt, change = clip(wanted[i] - a->reference[i], -most, most);
        a->reference[i] += change;
        a->feed[i] += dt / FEED * (m->ahead * change / dt - a->feed[i]);
        error[i] = a->reference[i] - a->measured_v[i];
        if (a->mode != SHUTTING && a->spool >= 1.0)
            a->integral[i] = clip(a->integral[i] + VELOCITY_INTEGRAL * dt * error[i], -7.0, 7.0);
        up[i] = VELOCITY_GAIN * error[i] + a->integral[i] + a->feed[i];
    }
    up[2] = clip(up[2] + vehicle->gravity, 0.3 * vehicle->gravity, 1.8 * vehicle->gravity);
    double side = sqrt(up[0] * up[0] + up[1] * up[1]), most = up[2] * tan(m->tilt);
    if (side > most) {
        up[0] *= most / side;
        up[1] *= most / side;
    }
    matrix(a->measured_q, r);
    double body_z[3] = {r[0][2], r[1][2], r[2][2]};
    wrench[0] = vehicle->mass * fmax(dot(up, body_z), 0.2 * vehicle->gravity);

    /* Tilt towards `up`, and turn towards the reference of the heading. */
    double ahead = remainder(a->goal_heading - a->heading, 2.0 * PI), length = norm(up), turned[3];
    double actual = atan2(r[1][0], r[0][0]);
    a->heading += clip(ahead, -m->turn * dt, m->turn * dt);
    ahead = clip(remainder(a->heading - actual, 2.0 * PI), -0.6, 0.6);
    a->heading = actual + ahead;
    for (int i = 0; i < 3; i++) up[i] /= length;
    cross(body_z, up, turned);
    double sine = norm(turned), angle = atan2(sine, dot(body_z, up));
    for (int i = 0; i < 3; i++) turned[i] *= sine > 1e-9 ? angle / sine : 0.0;
    to_body(r, turned, own);
    own[2] = ahead * r[2][2];
    for (int i = 0; i < 3; i++) {
        double off = m->stiffness * ATTITUDE_GAIN[i] * own[i] - a->measured_w[i];
        if (a->mode != SHUTTING && a->spool >= 1.0)
            a->spun[i] = clip(a->spun[i] + RATE_INTEGRAL[i] * dt * off, -25.0, 25.0);
        wrench[1 + i] = vehicle->inertia[i] * (m->stiffness * RATE_GAIN[i] * off + a->spun[i]);
    }
    if (a->mode == SHUTTING || a->mode == GROUNDED) a->spool = fmax(0.0, a->spool - dt / 0.4);
    else a->spool = fmin(1.0, a->spool + dt / 0.6);
    for (int i = 0; i < 4; i++) wrench[i] *= a->spool;
}

/* Allocate with the pseudo-inverse: roll and pitch first, then thrust, then yaw. */
static void allocate(struct plant *a, const double wrench[4], double command[ROTORS]) {
    const struct vehicle *vehicle = &a->vehicle;
    double k = vehicle->thrust, low = k * vehicle->slowest * vehicle->slowest;
    double high = k * vehicle->fastest * vehicle->fastest, turn[ROTORS], yaw[ROTORS];
    double least = 0.0, most = 0.0, share = 1.0, thrust = wrench[0] / vehicle->n;
    int n = (int)vehicle->n;
    for (int i = 0; i < n; i++) {
        turn[i] = vehicle->inverse[i][1] * wrench[1] + vehicle->inverse[i][2] * wrench[2];
        yaw[i] = vehicle->inverse[i][3] * wrench[3];
        least = fmin(least, turn[i]);
        most = fmax(most, turn[i]);
    }
    if (most - least > high - low) share = (high - low) / (most - least);
    thrust = clip(thrust, low - share * least, high - share * most);
    double spare = 1.0;
    for (int i = 0; i < n; i++) {
        turn[i] = thrust + share * turn[i];
        double room = yaw[i] > 0.0 ? high - turn[i] : turn[i] - low;
        if (fabs(yaw[i]) > 1e-12) spare = fmin(spare, fmax(room, 0.0) / fabs(yaw[i]));
    }
    for (int i = 0; i < n; i++)
        command[i] = clip(sqrt(clip(turn[i] + spare * yaw[i], low, high) / k),
                          vehicle->slowest, vehicle->fastest);
}

/* ---- what is called ---- */

size_t plant_size(void) { return sizeof(struct plant); }

void plant_start(struct plant *a, const struct vehicle *vehicle, const struct truth *truth,
                 const struct mission *mission, uint64_t seed, const double state[13]) {
    memset(a, 0, sizeof *a);
    a->vehicle = *vehicle;
    a->truth = *truth;
    a->mission = *mission;
    for (int i = 0; i < 4; i++) {
        uint64_t z = seed += 0x9e3779b97f4a7c15u;
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
        a->random[i] = z ^ (z >> 31);
    }
    memcpy(a->p, state, sizeof a->p);
    memcpy(a->v, state + 3, sizeof a->v);
    memcpy(a->q, state + 6, sizeof a->q);
    memcpy(a->w, state + 10, sizeof a->w);
    int n = (int)vehicle->n, standing = mission->period > 0.0;
    double hover = sqrt(vehicle->mass * vehicle->gravity / (n * vehicle->thrust));
    for (int i = 0; i < n; i++) {
        a->speed[i] = a->target[i] = standing ? vehicle->slowest : hover;
        a->induced[i] = a->speed[i] * sqrt(vehicle->thrust / (2.0 * DENSITY * PI)) / vehicle->radius;
        a->phase[i] = uniform(a, 0.0, 2.0 * PI);
        a->share[i] = a->bladed[i] = 1.0;
        a->rise[i] = truth->lag[i] > 0.0 ? 1.0 - exp(-STEP / truth->lag[i]) : 1.0;
        a->fall[i] = truth->lag[i] > 0.0 ? 1.0 - exp(-STEP / (truth->lag[i] * truth->braking)) : 1.0;
        a->upper[i] = -1;
        for (int j = 0; j < n; j++)
            if (fabs(vehicle->position[i][0] - vehicle->position[j][0]) < 1e-6
                    && fabs(vehicle->position[i][1] - vehicle->position[j][1]) < 1e-6
                    && vehicle->position[j][2] > vehicle->position[i][2]) a->upper[i] = j;
    }
    for (int i = 0; i < 5; i++) a->filter[i] = i == 0 ? normal(a) : normal(a) * sqrt(0.5);
    a->load = 1.0;
    a->mode = standing ? GROUNDED : AIRBORNE;
    a->spool = standing ? 0.0 : 1.0;
    a->next_hop = 2.0;
    a->next_goal = 3.0;
    memcpy(a->goal, a->p, sizeof a->p);
    a->push_begin = a->push_end = -1.0;
    a->push_next = 5.0;
    weigh(a);
    for (int i = 0; i < HISTORY; i++) {
        struct sample *sample = &a->past[i];
        memcpy(sample->p, a->p, sizeof a->p);
        memcpy(sample->v, a->v, sizeof a->v);
        memcpy(sample->q, a->q, sizeof a->q);
        memcpy(sample->w, a->w, sizeof a->w);
        sample->force[2] = vehicle->gravity;
    }
}

/* Measure a state, and compute the wrench that answers it. */
void plant_sense(struct plant *a, struct row *row, double wrench[4]) {
    double dt = STEP * PER_CONTROL;
    memset(row, 0, sizeof *row);
    measure(a, row);
    choose(a);
    control(a, dt, wrench);
}

/* Measure a state, and compute the command that answers it. */
void plant_answer(struct plant *a, struct row *row) {
    double wrench[4];
    plant_sense(a, row, wrench);
    if (a->mode == GROUNDED)
        for (int j = 0; j < (int)a->vehicle.n; j++) row->command[j] = a->vehicle.slowest;
    else
        allocate(a, wrench, row->command);
}

/* Send a command; return the number of steps until the next state. */
long plant_send(struct plant *a, const double command[ROTORS]) {
    double jitter = a->truth.jitter;
    long due = a->step + steps(fmax(a->truth.delay + uniform(a, -jitter, jitter), 0.0));
    int last = (a->first + a->waiting) % HISTORY;
    a->queue[last].due = due;
    memcpy(a->queue[last].command, command, sizeof a->queue[last].command);
    a->waiting++;
    a->next_control += PER_CONTROL;
    return a->next_control + steps(uniform(a, -jitter, jitter) / 2.0) - a->step;
}

/* Send a command, and move until the next state. */
void plant_act(struct plant *a, const double command[ROTORS]) {
    for (long i = plant_send(a, command); i > 0; i--) move(a);
}

/* Fly, as long as the vehicle is upright or has failed; return the number of rows. */
long plant_fly(struct plant *a, struct row *rows, long count) {
    for (long i = 0; i < count; i++) {
        plant_answer(a, &rows[i]);
        plant_act(a, rows[i].command);
        double r[3][3];
        matrix(a->q, r);
        if (!a->failed && !(r[2][2] > -0.2)) return i + 1;
    }
    return count;
}

/* For a body that others move: force (world) and torque (body) of a step, but those of feet. */
void plant_forces(struct plant *a, double wrench[6]) {
    double r[3][3];
    memset(wrench, 0, 6 * sizeof *wrench);
    forces(a, r, wrench, wrench + 3);
}

/* Take the state after a step that others moved, with its accelerations (world, body). */
void plant_place(struct plant *a, const double state[13], const double accelerations[6],
                 double touching) {
    double r[3][3], force[3] = {accelerations[0], accelerations[1], accelerations[2]};
    struct sample *sample = &a->past[a->step % HISTORY];
    memcpy(a->p, state, sizeof a->p);
    memcpy(a->v, state + 3, sizeof a->v);
    memcpy(a->q, state + 6, sizeof a->q);
    memcpy(a->w, state + 10, sizeof a->w);
    matrix(a->q, r);
    force[2] += a->vehicle.gravity;
    to_body(r, force, sample->force);
    memcpy(sample->turning, accelerations + 3, sizeof sample->turning);
    a->touching = (int)touching;
    keep(a);
}

/* Move without sensors and controller at constant commands, for tests. */
void plant_drift(struct plant *a, const double command[ROTORS], long count) {
    memcpy(a->target, command, sizeof a->target);
    for (long i = 0; i < count; i++) move(a);
}

void plant_state(const struct plant *a, double state[13], double speeds[ROTORS]) {
    memcpy(state, a->p, sizeof a->p);
    memcpy(state + 3, a->v, sizeof a->v);
    memcpy(state + 6, a->q, sizeof a->q);
    memcpy(state + 10, a->w, sizeof a->w);
    memcpy(speeds, a->speed, sizeof a->speed);
}

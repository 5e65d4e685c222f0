#include "detector.h"

#include <string.h>

#include "numbers.h"

/* The constants of ca_ros/detection: disturbances, hypothesis_test, leads, losses, motion_test,
 * motor_model, noise_estimator, pairs, rotor_beliefs, speed_residual, windows; and of
 * ca_ros/control/momentum_observer. */
#define BLOCK CA_REAL(0.00943)
#define HALF CA_REAL(0.505)
#define CONFIRMATIONS 3
#define IN_A_ROW 3
#define REFINED CA_REAL(0.495)
#define USELESS CA_REAL(0.2)
#define TOTAL CA_REAL(0.8)
#define TOLD CA_REAL(0.995)
#define CERTAIN CA_REAL(0.995)
#define SUSPICION CA_REAL(6.0)
#define PATIENCE CA_REAL(0.995)
#define SETTLING CA_REAL(4.0)
#define FLOOR CA_REAL(0.3)
#define OUTLIER CA_REAL(9.0)
#define LEARNT CA_REAL(0.95)
#define CLEAR_LOSS CA_REAL(0.35)
#define LEAST_LOSS CA_REAL(0.4)
#define MOST_LOSS CA_REAL(1.3)
#define ALIKE CA_REAL(0.7)
#define WEAK_LOSS CA_REAL(0.3)
#define ASKED CA_REAL(0.75)
#define THRUST_ERROR CA_REAL(0.1)
#define TIME_ERROR CA_REAL(0.01)
#define COMMON_ERROR CA_REAL(0.25)
#define RECENT CA_REAL(1.0)
#define DRAG_LOST CA_REAL(0.5)
#define LIMIT CA_REAL(20.0)
#define ODDS CA_REAL(5.3)
#define TELLING CA_REAL(6.5)
#define MARGIN CA_REAL(4.0)
#define CONTACT CA_REAL(4.0)
#define LASTING CA_REAL(4.0)
#define GATHERED 2
#define SEEN CA_REAL(15.0)
#define EXCESS CA_REAL(1.2)
#define DOUBT CA_REAL(6.0)
#define DEBT CA_REAL(30.0)
#define SMALL_DEBT CA_REAL(8.0)
#define PRIOR CA_REAL(6.25)
#define GIVING CA_REAL(1.0)
#define PAIR_ODDS CA_REAL(1.0)
#define PAIRED CA_REAL(0.1)
#define NEAR CA_REAL(0.5)
#define LEARNING CA_REAL(2.0)
#define TRIM CA_REAL(0.15)
#define LONG_LEARNING CA_REAL(20.0)
#define RESTART INT64_C(2000000000)
#define GAP INT64_C(500000000)
#define MOST 2
#define STALE INT64_C(60000000)
#define LATE INT64_C(100000000)
#define HELD 70000000
#define KEPT 2000000000
#define KEEP CA_REAL(1.0)
#define MOTION CA_REAL(0.05)
#define AVERAGING CA_REAL(0.2)
#define REST CA_REAL(0.5)

static const ca_real WINDOWS[CA_WINDOWS] = {CA_REAL(0.04), CA_REAL(0.08), CA_REAL(0.16),
                                            CA_REAL(0.24), CA_REAL(0.32)};

#define ROTORS(model) ((int)(model)->rotors)

/* 1 - exp(-x) for x >= 0: what a first-order lag settles in x time constants. */
static ca_real settled(ca_real x)
{
    int halvings = 0;
    ca_real share = 1;
    if (x > CA_REAL(45.0))
        return 1;
    for (; x > CA_REAL(0.5); halvings++)
        x *= CA_REAL(0.5);
    for (int k = CA_CHOOSE_INT(14, 8); k > 1; k--)
        share = 1 - x / (ca_real)k * share;
    share *= x;
    for (; halvings; halvings--)
        share *= 2 - share;
    return share;
}

static int most(int a, int b)
{
    return a > b ? a : b;
}

static int64_t distance(int64_t a, int64_t b)
{
    return a < b ? b - a : a - b;
}

static ca_real seconds(int64_t nanoseconds)
{
    return (ca_real)nanoseconds / CA_REAL(1e9);
}

static int is_time(int64_t time)
{
    return -CA_TIME_MAX < time && time < CA_TIME_MAX;
}

/* Whether all numbers are finite and within bounds. */
static int within(int count, const ca_real *numbers, ca_real lower, ca_real upper)
{
    int sound = 1;
    for (int i = 0; i < count; i++)
        sound &= ca_is_finite(&numbers[i]) && numbers[i] >= lower && numbers[i] <= upper;
    return sound;
}

static void rotate(const ca_real rotation[3][3], const ca_real *vector, ca_real *rotated)
{
    for (int k = 0; k < 3; k++)
        rotated[k] = ca_dot(3, rotation[k], vector);
}

static void rotate_back(const ca_real rotation[3][3], ca_real *vector)
{
    const ca_real x = vector[0], y = vector[1], z = vector[2];
    for (int k = 0; k < 3; k++)
        vector[k] = rotation[0][k] * x + rotation[1][k] * y + rotation[2][k] * z;
}

/* Commanded rotors. */

int ca_detector_command(ca_detector *detector, int64_t time, const ca_real *speeds)
{
    const ca_detector_model *model = detector->model;
    const int n = ROTORS(model);
    int at = detector->waiting;
    if (!is_time(time) || !within(n, speeds, -CA_ABSURD, CA_ABSURD))
        return -1;
    if (detector->timed && time - detector->time >= RESTART)
        return 0;
    const int64_t due = time + (int64_t)(model->delay * CA_REAL(1e9) + CA_REAL(0.5));
    ca_real followed[CA_N];
    for (int i = 0; i < n; i++)
        followed[i] = ca_clip(speeds[i], model->least[i], model->greatest[i]);
    if (!detector->has_command || time - detector->commanded >= STALE)
        memset(detector->least, 0, sizeof detector->least);
    detector->commanded = time;
    detector->has_command = 1;
    for (int i = 0; i < n; i++)
        detector->least[0][i] = ca_min(detector->least[0][i], ca_abs(followed[i]));
    if (at == CA_COMMANDS) {
        at--;
        memmove(detector->due, detector->due + 1, (size_t)at * sizeof *detector->due);
        memmove(detector->commands, detector->commands + 1,
                (size_t)at * sizeof *detector->commands);
    }
    detector->waiting = at + 1;
    for (; at > 0 && detector->due[at - 1] > due; at--) {
        detector->due[at] = detector->due[at - 1];
        ca_copy(n, detector->commands[at - 1], detector->commands[at]);
    }
    detector->due[at] = due;
    ca_copy(n, followed, detector->commands[at]);
    return 0;
}

/* Forget all commands. */
static void start_rotors(ca_detector *detector)
{
    detector->waiting = 0;
    for (int i = 0; i < ROTORS(detector->model); i++)
        detector->command[i] = detector->speeds[i] = 0;
    detector->known = 1;
    detector->in_force = CA_TIME_MAX;
    detector->unsettled = 0;
}

/* The time in which the speeds of the motors follow a command [ns]. */
static int64_t settling_of(const ca_detector_model *model)
{
    const ca_real settling = SETTLING * model->time_constant + model->delay;
    return (int64_t)(1000 * settling + CA_REAL(0.5)) * 1000000;
}

/* Let the speeds be unknown until they have settled. */
static void lose(ca_detector *detector)
{
    detector->known = 0;
    detector->unsettled = settling_of(detector->model);
}

/* Set the mean thrusts between two times, as of sound rotors. */
static void advance_rotors(ca_detector *detector, int64_t start, int64_t end, ca_real *thrusts)
{
    const ca_detector_model *model = detector->model;
    const int n = ROTORS(model);
    int taken = 0;
    for (int i = 0; i < n; i++)
        thrusts[i] = 0;
    detector->known = detector->unsettled == 0;
    while (start < end) {
        for (; taken < detector->waiting && detector->due[taken] <= start; taken++) {
            detector->in_force = detector->due[taken];
            ca_copy(n, detector->commands[taken], detector->command);
        }
        int64_t until = end;
        if (taken < detector->waiting && detector->due[taken] < end)
            until = detector->due[taken];
        const ca_real step = seconds(until - start);
        const ca_real share = model->time_constant > 0 ? settled(step / model->time_constant) : 1;
        for (int i = 0; i < n; i++) {
            const ca_real before = detector->speeds[i];
            const ca_real after = before + share * (detector->command[i] - before);
            const ca_real mean = CA_REAL(0.5) * (before + after);
            thrusts[i] += step * (mean < 0 ? -model->reverse_thrust[i] * (mean * mean)
                                           : model->thrust[i] *
                                                 ca_curve((int)model->segments, model->curve, mean));
            detector->speeds[i] = after;
        }
        if (share >= 1)
            ca_copy(n, detector->command, detector->speeds);
        const int64_t unsettled = detector->unsettled - (until - start);
        detector->unsettled = unsettled > 0 ? unsettled : 0;
        /* The next command has been lost. */
        if (until - detector->in_force > HELD)
            lose(detector);
        start = until;
    }
    detector->waiting -= taken;
    memmove(detector->due, detector->due + taken,
            (size_t)detector->waiting * sizeof *detector->due);
    memmove(detector->commands, detector->commands + taken,
            (size_t)detector->waiting * sizeof *detector->commands);
}

/* Measured speeds. */

/* How much older than the last command measured speeds may be. */
static int64_t oldest_measurement(const ca_detector *detector)
{
    const ca_real lag = detector->model->time_constant + detector->model->delay;
    return LATE + (int64_t)(CA_REAL(1e9) * lag + CA_REAL(0.5));
}

/* Keep the least of the speeds that the commands should have given until a time. */
static void expect_speeds(ca_detector *detector, int64_t time)
{
    const int n = ROTORS(detector->model);
    const int64_t length = oldest_measurement(detector) / 2;
    const int64_t interval = time / length - (time % length < 0);
    if (interval != detector->interval) {
        detector->interval = interval;
        memmove(detector->least[1], detector->least[0], 2 * sizeof *detector->least);
        for (int i = 0; i < n; i++)
            detector->least[0][i] = CA_UNBOUNDED;
    }
    for (int i = 0; i < n; i++)
        detector->least[0][i] = ca_min(detector->least[0][i], ca_abs(detector->speeds[i]));
}

/* Momentum observer. */

/* Return whether the vehicle stands after a step. */
static int stands(ca_detector *detector, ca_real step, const ca_real *motion)
{
    const ca_real share = ca_min(1, step / AVERAGING);
    int moved = 0, unbalanced = 0;
    for (int k = 0; k < 6; k++) {
        detector->mean_motion[k] += share * (motion[k] - detector->mean_motion[k]);
        moved |= ca_abs(detector->mean_motion[k]) > MOTION;
    }
    if (moved) {
        detector->standing = 0;
        detector->still = 0;
        return 0;
    }
    detector->still += step;
    for (int k = 0; k < 4; k++)
        unbalanced |= ca_abs(detector->wrench[k + 2]) > detector->model->balance[k];
    detector->standing |= unbalanced && detector->still > REST;
    return detector->standing;
}

/* Update the estimate after a step; return whether what the step lacks counts. */
static int update(ca_detector *detector, ca_real step, const ca_real *gained,
                  const ca_real *motion, ca_real gain)
{
    const int stood = detector->standing;
    const ca_real known = stood ? 0 : step;
    ca_real lacked[6];
    int jumped = 0;
    for (int k = 0; k < 6; k++) {
        lacked[k] = gained[k] - known * (detector->wrench[k] + detector->estimate[k]);
        jumped |= !ca_is_finite(&lacked[k]) || ca_abs(lacked[k]) > detector->model->jump[k];
    }
    if (step > 0 && jumped)
        return 0;
    if (stands(detector, step, motion) || stood) {
        if (!stood)
            ca_copy(6, detector->before, detector->estimate);
        return 0;
    }
    const ca_real share = settled(gain * step);
    for (int k = 0; k < 6; k++)
        detector->estimate[k] += share / step * lacked[k];
    ca_copy(6, lacked, detector->lacked);
    /* `still` is 0 unless the vehicle rests. */
    if (!(detector->still > 0))
        detector->kept += step;
    if (detector->kept > KEEP) {
        ca_copy(6, detector->latest, detector->before);
        ca_copy(6, detector->estimate, detector->latest);
        detector->kept = 0;
    }
    return 1;
}

/* Set the observer to the beginning of a flight. */
static void start_observer(ca_detector *detector)
{
    for (int k = 0; k < 6; k++)
        detector->estimate[k] = detector->before[k] = detector->latest[k] =
            detector->mean_motion[k] = 0;
    detector->kept = detector->still = 0;
    detector->standing = 1;
}

/* Whether a state of this time is ignored; it may be the first of a new flight. */
static int ignores(ca_detector *detector, int64_t time)
{
    if (!detector->timed || (time > detector->time && time - detector->time < GAP))
        return 0;
    if (detector->interrupted && time > detector->time)
        return 0;
    const int far = time - detector->time >= GAP || detector->time - time >= RESTART;
    const int confirmed = detector->doubted && distance(time, detector->doubtful) < RESTART;
    if (far && !confirmed) {
        detector->doubtful = time;
        detector->doubted = 1;
    }
    return !far || !confirmed;
}

/* The test. */

typedef struct {
    ca_real evidence[CA_N];                /* for the loss of each rotor, of its best window */
    ca_real disturbance;                   /* the same for a disturbance */
    int rotor, window, names, named[4];    /* the likeliest rotor, and what is named */
    int open[4];                           /* 1 for both rotors of an arm of which one has failed */
    ca_real lost[4];
    ca_real shares[CA_N], errors[CA_N];    /* lost by each rotor alone in the longest window */
    ca_real most[CA_N];                    /* the same, the most in any window */
    ca_real levels[CA_N];                  /* what each has left, an arm as one effector */
    ca_real leads[CA_N];                   /* gathered so far */
    int gathers;                           /* whether every rotor may gather: no loss is recent */
    int lasting, pair;                     /* whether leads name it; whether two have failed */
} finding;

/* What a failed rotor no longer gives in a window, and the variance of this: its thrust, known to a
 * tenth, of whose variance a share counts, and half of its drag, which a weak rotor keeps and a lost
 * propeller loses. */
static void signature_of(const ca_detector_model *model, const ca_block *window, int rotor,
                         ca_real share, ca_real *given, ca_real *error)
{
    const ca_real thrust = window->given[rotor], relative = THRUST_ERROR * thrust;
    /* Drag goes with the speed of a rotor, here with its thrust. */
    const ca_real part = DRAG_LOST * ca_abs(thrust) / ca_max(window->total, CA_REAL(1e-9));
    const ca_real x = part * window->lateral[0], y = part * window->lateral[1];
    const ca_real drag[6] = {x,
                             y,
                             0,
                             -model->arms[2][rotor] * y,
                             model->arms[2][rotor] * x,
                             model->arms[0][rotor] * y - model->arms[1][rotor] * x};
    for (int k = 0; k < 6; k++) {
        given[k] = thrust * model->wrenches[k][rotor] + drag[k];
        error[k] = share * (relative * relative) * model->unit[k] + drag[k] * drag[k];
    }
}

/* The other rotor of a coaxial pair, or -1. */
static int partner_of(const ca_detector_model *model, int rotor)
{
    return (int)model->partner[rotor];
}

/* The signature of a rotor that may fail next: those of a named arm both have the arm's mean. */
static void effector_of(const ca_detector *detector, const ca_block *window, int rotor,
                        ca_real *given, ca_real *error)
{
    ca_real others[6], errors[6];
    signature_of(detector->model, window, rotor, 1, given, error);
    if (!detector->arm[rotor])
        return;
    signature_of(detector->model, window, partner_of(detector->model, rotor), 1, others, errors);
    for (int k = 0; k < 6; k++) {
        given[k] = CA_REAL(0.5) * (given[k] + others[k]);
        error[k] = CA_REAL(0.5) * (error[k] + errors[k]);
    }
}

/* The health that a rotor has left, or both of a named arm together. */
static ca_real level_of(const ca_detector *detector, int rotor)
{
    const ca_real health = detector->health[rotor];
    return detector->arm[rotor] ? health + detector->health[partner_of(detector->model, rotor)]
                                : health;
}

/* Name a rotor, too, or the arm of which it is one. */
static void name(finding *found, int rotor, ca_real share, int partner, int arm)
{
    int *named = &found->named[found->names], *open = &found->open[found->names];
    ca_real *lost = &found->lost[found->names];
    found->names += 1 + arm;
    named[0] = rotor;
    lost[0] = share;
    open[0] = arm;
    if (arm) {
        named[0] = rotor < partner ? rotor : partner;
        named[1] = rotor < partner ? partner : rotor;
        lost[0] = lost[1] = CA_REAL(0.5) * share;
        open[1] = 1;
    }
}

/* Find two rotors whose failures explain a window; name them if their evidence is over a bound.
 * Return the evidence for the likeliest two; none while the trim is not known, as two rotors can
 * explain almost any trim. */
static ca_real find_pair(const ca_detector *detector, const ca_block *window,
                         const ca_real *variance, ca_real bound, finding *found)
{
    const ca_detector_model *model = detector->model;
    const int n = ROTORS(model);
    ca_real given[CA_N][6], errors[CA_N][6], scores[CA_N][CA_N], best = 0, lost[2] = {0, 0};
    ca_real least[CA_N], most[CA_N], taken[6], seen = 0;
    int pair[2] = {0, 0}, open[2] = {0, 0};
    if (!(detector->flown > LEARNING))
        return 0;
    for (int k = 0; k < 6; k++)
        seen += window->impulse[k] * window->impulse[k] / variance[k];
    for (int i = 0; i < n; i++) {
        signature_of(model, window, i, PAIRED, given[i], errors[i]);
        /* A named arm is no part of a pair. */
        const ca_real health = detector->arm[i] ? 0 : detector->health[i];
        least[i] = LEAST_LOSS * ca_max(health, CA_REAL(1e-9));
        most[i] = MOST_LOSS * health;
    }
    for (int i = 0; i < n; i++)
        for (int j = i + 1; j < n; j++) {
            scores[i][j] = 0;
            ca_real a = 0, b = 0, ab = 0, aa = 0, bb = 0, rest = seen, ratio = 1;
            for (int k = 0; k < 6; k++) {
                const ca_real v = variance[k] + errors[i][k] + errors[j][k], inverse = 1 / v;
                const ca_real one = given[i][k] * inverse, other = given[j][k] * inverse;
                const ca_real c = window->impulse[k];
                a -= one * c;
                b -= other * c;
                aa += one * given[i][k];
                bb += other * given[j][k];
                ab += one * given[j][k];
                rest -= c * c * inverse;
                ratio *= v / variance[k];
            }
            /* Rotors with parallel wrenches cannot be told apart. */
            const ca_real determinant = aa * bb - ab * ab;
            if (!(determinant > CA_REAL(1e-6) * (aa * bb)))
                continue;
            const ca_real one = (bb * a - ab * b) / determinant;
            const ca_real other = (aa * b - ab * a) / determinant;
            if (!(one >= least[i] && other >= least[j] && one <= most[i] && other <= most[j]))
                continue;
            /* Where one loses much less, it makes up for what the other does not explain. */
            if (!(one * most[j] >= ALIKE * (other * most[i]) &&
                  other * most[i] >= ALIKE * (one * most[j])))
                continue;
            const ca_real prior = ca_max(1, aa / PRIOR) * ca_max(1, bb / PRIOR);
            const ca_real score =
                CA_REAL(0.5) * (rest + one * a + other * b - ca_log(ratio * prior));
            scores[i][j] = score;
            if (score > best) {
                best = score;
                pair[0] = i;
                pair[1] = j;
                lost[0] = one;
                lost[1] = other;
            }
        }
    if (best <= LIMIT || best <= bound)
        return best;
    const int others[2] = {partner_of(model, pair[0]), partner_of(model, pair[1])};
    for (int i = 0; i < n; i++)
        for (int j = i + 1; j < n; j++) {
            if (best - scores[i][j] > ODDS || (i == pair[0] && j == pair[1]))
                continue;
            /* Those of the same two arms are no rivals. */
            int first = -1, second = -1;
            for (int k = 0; k < 2; k++) {
                const int rotor = k ? j : i;
                first = rotor == pair[0] || rotor == others[0] ? rotor : first;
                second = rotor == pair[1] || rotor == others[1] ? rotor : second;
            }
            if (first < 0 || second < 0 || others[0] == pair[1])
                return best;
            open[0] |= first != pair[0];
            open[1] |= second != pair[1];
        }
    for (int k = 0; k < 6; k++)
        taken[k] = given[pair[0]][k] * lost[0] + given[pair[1]][k] * lost[1];
    if (ca_length(3, taken + 3) < model->lever * ca_length(3, taken))
        return best;
    found->pair = 1;
    for (int k = 0; k < 2; k++)
        name(found, pair[k], ca_min(lost[k], detector->health[pair[k]]), others[k], open[k]);
    return best;
}

/* Whether a rotor is asked for enough thrust to be named, over its usual one or that of hover.  One
 * that idles after a failure is asked for more only when something turns the vehicle. */
static int is_asked(const ca_detector *detector, const ca_block *window, int rotor)
{
    const ca_real hover = ca_sqrt(detector->model->disturbance[0][0]);
    const ca_real usual = ca_abs(detector->mean_thrusts[rotor]), half = CA_REAL(0.5) * hover;
    const ca_real least = ASKED * ca_clip(usual, half, hover);
    if (usual < ASKED * half)
        for (int i = 0; i < ROTORS(detector->model); i++)
            if (detector->health[i] < 1)
                return 0;
    return ca_abs(window->given[rotor]) >= least * window->length;
}

/* The evidence for the likelier one of a push and a contact with the ground, which pushes up. */
static ca_real of_disturbances(const ca_detector_model *model, const ca_block *window,
                               const ca_real *variance, ca_real seen)
{
    const ca_real square = window->length * window->length;
    ca_real evidence = 0;
    for (int kind = 0; kind < (window->impulse[2] > 0 ? 2 : 1); kind++) {
        ca_real left = 0, ratio = 1;
        for (int k = 0; k < 6; k++) {
            const ca_real c = window->impulse[k];
            const ca_real disturbed = variance[k] + square * model->disturbance[kind][k];
            left += c * c / disturbed;
            ratio *= disturbed / variance[k];
        }
        const ca_real each = CA_REAL(0.5) * (seen - left - ca_log(ratio));
        evidence = kind ? ca_max(evidence, each + CONTACT) : each;
    }
    return evidence;
}

/* The window that shows how much a rotor lost: of those that show its loss, the one with the
 * greatest share, since longer ones began before. */
static int telling_window(const ca_real evidence[CA_WINDOWS][CA_N],
                          const ca_real shares[CA_WINDOWS][CA_N], int rotor)
{
    ca_real best = 0, share = -1;
    int window = 0;
    for (int t = 0; t < CA_WINDOWS; t++)
        best = ca_max(best, evidence[t][rotor]);
    for (int t = 0; t < CA_WINDOWS; t++)
        if (evidence[t][rotor] >= NEAR * best && shares[t][rotor] > share) {
            share = shares[t][rotor];
            window = t;
        }
    return window;
}

/* Gather how far each rotor leads all else in one window; name one that leads for long.
 * Nothing is gathered while the trim is not known: in the beginning of a flight, and by others
 * than a `recent` loss.  A rotor that a disturbance leads gets a debt, a greater one if it lacks more
 * than it has, `lacking` where the disturbance is likeliest, but none while a loss is `recent`. */
static void gather(const ca_detector *detector, const ca_block *window, ca_real block,
                   const ca_real evidences[CA_WINDOWS][CA_N],
                   const ca_real shares[CA_WINDOWS][CA_N], ca_real disturbance,
                   const ca_real *lacking, const int *recent, finding *found)
{
    const ca_real *evidence = evidences[GATHERED];
    const ca_detector_model *model = detector->model;
    const int n = ROTORS(model);
    int top = 0;
    if (!(detector->flown > LEARNING)) {
        memset(found->leads, 0, sizeof found->leads);
        return;
    }
    for (int i = 0; i < n; i++) {
        const int partner = partner_of(model, i);
        ca_real rival = ca_max(disturbance, 0), most = CA_UNBOUNDED;
        for (int j = 0; j < n; j++)
            if (j != i && j != partner) {
                rival = ca_max(rival, evidence[j]);
                most = recent[j] ? 0 : most;
            }
        const ca_real lead = ca_min(evidence[i] - rival, LIMIT), before = detector->leads[i];
        const ca_real after = before + block / WINDOWS[GATHERED] * lead;
        found->leads[i] = ca_max(ca_min(after, most), ca_min(before, 0));
        const ca_real doubt = found->disturbance - found->evidence[i];
        const int excess = lacking[i] > EXCESS * found->levels[i];
        if (found->evidence[i] > LIMIT && doubt > DOUBT && found->gathers)
            found->leads[i] = ca_min(found->leads[i], excess ? -DEBT : -SMALL_DEBT);
        top = found->leads[i] > found->leads[top] ? i : top;
    }
    if (found->names || !(found->leads[top] > LASTING && evidence[top] > SEEN) ||
        found->most[top] < WEAK_LOSS * found->levels[top] || !is_asked(detector, window, top))
        return;
    const int partner = partner_of(model, top);
    found->rotor = top;
    found->window = telling_window(evidences, shares, top);
    found->lasting = 1;
    name(found, top, shares[found->window][top], partner,
         partner >= 0 && found->levels[partner] > 0 &&
             evidence[top] - evidence[partner] <= ODDS);
}

/* What the loss of a share of one rotor's thrust explains of a window. */
typedef struct {
    ca_real evidence, share; /* of the likeliest loss; share < 0: it gives more than commanded */
    ca_real raw, error;      /* the loss without bounds, and its standard deviation */
} loss;

static loss of_loss(const ca_detector *detector, const ca_block *window, const ca_real *variance,
                    ca_real seen, int rotor, ca_real level)
{
    const ca_real *c = window->impulse;
    ca_real given[6], error[6], product = 0, norm = CA_REAL(1e-12), rest = 0, ratio = 1;
    loss found = {0, 0, 0, 0};
    effector_of(detector, window, rotor, given, error);
    for (int k = 0; k < 6; k++) {
        const ca_real weighted = given[k] / (variance[k] + error[k]);
        product -= weighted * c[k];
        norm += weighted * given[k];
    }
    found.raw = product / norm;
    found.error = 1 / ca_sqrt(norm);
    /* A rotor may give more than commanded: a negative share, down to that of its peak. */
    const ca_real peak = window->length * detector->peaks[rotor];
    const ca_real own =
        ca_max(ca_abs(window->given[rotor]), CA_REAL(0.01) * peak + CA_REAL(1e-9));
    const ca_real lower = found.raw < 0 ? ca_min(1 - peak / own, 0) : 0;
    const ca_real upper = found.raw < 0 ? 0 : level;
    const ca_real first = ca_clip(found.raw, lower, upper);
    if (!(ca_abs(first) > 0))
        return found;
    product = 0;
    norm = CA_REAL(1e-12);
    for (int k = 0; k < 6; k++) {
        const ca_real wider = variance[k] + first * first * error[k], inverse = 1 / wider;
        product -= given[k] * c[k] * inverse;
        norm += given[k] * given[k] * inverse;
        rest += c[k] * c[k] * inverse;
        ratio *= wider / variance[k];
    }
    found.share = ca_clip(product / norm, lower, upper);
    found.evidence =
        CA_REAL(0.5) * (seen - rest + found.share * (2 * product - found.share * norm) -
                        ca_log(ratio * ca_max(1, norm / PRIOR)));
    return found;
}

/* Name what the evidence of this test shows: the likeliest rotor, or two. */
static void name_now(const ca_detector *detector, const ca_block *windows,
                     const ca_real variance[CA_WINDOWS][6],
                     const ca_real evidence[CA_WINDOWS][CA_N],
                     const ca_real shares[CA_WINDOWS][CA_N], int likeliest, finding *found)
{
    const int n = ROTORS(detector->model);
    int rotor = 0, leads = 1;
    for (int i = 1; i < n; i++)
        rotor = found->evidence[i] > found->evidence[rotor] ? i : rotor;
    const ca_real best = found->evidence[rotor];
    const ca_real bound = ca_max(best, found->disturbance) + ODDS;
    found->rotor = rotor;
    found->names = found->lasting = found->pair = 0;
    found->window = likeliest;
    if (best <= LIMIT || best - found->disturbance <= MARGIN) {
        if (found->disturbance > LIMIT)
            find_pair(detector, &windows[likeliest], variance[likeliest], bound, found);
        return;
    }
    found->window = telling_window(evidence, shares, rotor);
    const ca_real share = shares[found->window][rotor];
    const int partner = partner_of(detector->model, rotor);
    for (int i = 0; i < n; i++)
        leads &= i == rotor || i == partner || best - found->evidence[i] > ODDS;
    if (!leads || share < CLEAR_LOSS * found->levels[rotor] ||
        detector->leads[rotor] < 0 || !is_asked(detector, &windows[found->window], rotor))
        return;
    /* The rotor between two lost ones explains their torque. */
    const ca_real pair = find_pair(detector, &windows[found->window], variance[found->window],
                                   bound, found);
    /* What shows only in the window of leads or a longer one is named by its lead, while leads are
     * gathered. */
    const int early = found->window < GATHERED || !found->gathers;
    if (!found->names && early && best > pair - PAIR_ODDS)
        name(found, rotor, share, partner,
             partner >= 0 && best - found->evidence[partner] <= ODDS);
}

/* Test all windows against the failure of each rotor, and against a disturbance. */
static void test(const ca_detector *detector, const ca_block *windows, ca_real block,
                 const ca_real variance[CA_WINDOWS][6], const int *recent, finding *found)
{
    const ca_detector_model *model = detector->model;
    const int n = ROTORS(model);
    ca_real evidence[CA_WINDOWS][CA_N], shares[CA_WINDOWS][CA_N], disturbances[CA_WINDOWS];
    ca_real lacking[CA_WINDOWS][CA_N];
    int likeliest = 0, failed = 0;
    for (int i = 0; i < n; i++) {
        found->evidence[i] = 0;
        found->levels[i] = level_of(detector, i);
        failed |= recent[i];
    }
    found->disturbance = 0;
    found->gathers = detector->flown > LEARNING && !failed;
    for (int t = 0; t < CA_WINDOWS; t++) {
        const ca_real *v = variance[t];
        ca_real seen = 0;
        for (int k = 0; k < 6; k++)
            seen += windows[t].impulse[k] * windows[t].impulse[k] / v[k];
        disturbances[t] = of_disturbances(model, &windows[t], v, seen);
        for (int i = 0; i < n; i++) {
            const loss each = of_loss(detector, &windows[t], v, seen, i, found->levels[i]);
            found->shares[i] = lacking[t][i] = each.raw;
            found->most[i] = t ? ca_max(found->most[i], each.raw) : each.raw;
            found->errors[i] = each.error;
            shares[t][i] = ca_max(each.share, 0);
            evidence[t][i] = each.raw < 0 ? 0 : each.evidence;
            found->evidence[i] = ca_max(found->evidence[i], evidence[t][i]);
            if (each.raw < 0 && each.evidence > 0)
                disturbances[t] = ca_max(disturbances[t], each.evidence + GIVING);
        }
        if (disturbances[t] > found->disturbance) {
            found->disturbance = disturbances[t];
            likeliest = t;
        }
    }
    name_now(detector, windows, variance, (const ca_real(*)[CA_N])evidence,
             (const ca_real(*)[CA_N])shares, likeliest, found);
    gather(detector, &windows[GATHERED], block, (const ca_real(*)[CA_N])evidence,
           (const ca_real(*)[CA_N])shares, disturbances[GATHERED], lacking[likeliest], recent,
           found);
}

/* Set, for the first rotor of each named arm, the evidence that it has failed, less that of its
 * partner, if a window shows more than those before. */
static void compare_arms(const ca_detector *detector, const ca_block *window,
                         const ca_real *variance, ca_real *evidence)
{
    const ca_detector_model *model = detector->model;
    ca_real apart[(CA_N + 1) / 2][6], own[(CA_N + 1) / 2], wider[6], given[6], others[6], error[6];
    int arms = 0, rotors[(CA_N + 1) / 2];
    ca_copy(6, variance, wider);
    for (int i = 0; i < ROTORS(model); i++) {
        const ca_real lost = detector->announced[i] - detector->health[i];
        if (!detector->arm[i] || partner_of(model, i) < i)
            continue;
        signature_of(model, window, partner_of(model, i), 1, others, error);
        signature_of(model, window, i, 1, given, error);
        for (int k = 0; k < 6; k++) {
            apart[arms][k] = lost * (given[k] - others[k]);
            wider[k] += 4 * lost * lost * error[k];
        }
        rotors[arms++] = i;
    }
    for (int a = 0; a < arms; a++) {
        own[a] = 0;
        for (int k = 0; k < 6; k++)
            own[a] += apart[a][k] * window->impulse[k] / wider[k];
    }
    for (int a = 0; a < arms; a++) {
        ca_real ratio = -2 * own[a];
        for (int b = 0; b < arms; b++) {
            if (b == a)
                continue;
            /* Of the two rotors of each other arm the likelier one has failed. */
            ca_real both = 0;
            for (int k = 0; k < 6; k++)
                both += apart[a][k] * apart[b][k] / wider[k];
            ratio += ca_abs(own[b] + both) - ca_abs(own[b] - both);
        }
        if (ca_abs(ratio) > ca_abs(evidence[rotors[a]]))
            evidence[rotors[a]] = ratio;
    }
}

/* The detector. */

static int suspicious(const ca_detector *detector)
{
    return detector->waited > 0 && detector->waited < PATIENCE;
}

/* A rate of learning: greater in the beginning of a flight. */
static ca_real learning_gain(const ca_detector *detector, ca_real time)
{
    if (suspicious(detector))
        return 0;
    return 1 / ca_min(time, detector->flown + CA_REAL(0.05));
}

/* Let the speeds of the motors be unknown, and what is usual: what rotors lack is learnt as trim. */
static void blind(ca_detector *detector)
{
    detector->blind = settling_of(detector->model);
    detector->rested = 0;
    for (int i = 0; i < ROTORS(detector->model); i++)
        detector->refined[i] += TOLD;
}

/* Suspect nothing. */
static void clear_suspicion(ca_detector *detector)
{
    memset(detector->leads, 0, sizeof detector->leads);
    detector->waited = 0;
    detector->count = detector->names = 0;
    detector->suspect = -1;
    detector->probabilities[ROTORS(detector->model)] = 0;
    for (int i = 0; i < ROTORS(detector->model); i++)
        if (!detector->order[i])
            detector->probabilities[i] = 0;
}

/* Begin a flight: the windows reach back to now. */
static void begin(ca_detector *detector)
{
    clear_suspicion(detector);
    detector->flown = detector->unlearnt = 0;
    ca_copy(6, detector->motion, detector->learnt);
    memset(detector->thrusts, 0, sizeof detector->thrusts);
    memset(detector->peaks, 0, sizeof detector->peaks);
    memset(&detector->sums, 0, sizeof detector->sums);
    memset(detector->blocks, 0, sizeof detector->blocks);
}

/* The block of an age: that of age 0 is the newest. */
static ca_block *block_of(ca_detector *detector, int age)
{
    const int place = detector->newest + age;
    return &detector->blocks[place < CA_BLOCKS ? place : place - CA_BLOCKS];
}

/* Let no window be longer than this number of blocks, and no rotor lead. */
static void forget(ca_detector *detector, int kept)
{
    memset(detector->leads, 0, sizeof detector->leads);
    for (; kept < CA_BLOCKS; kept++)
        memset(block_of(detector, kept), 0, sizeof *detector->blocks);
}

/* Take a share of a rotor's health, as if from the start of the windows on. */
static void reduce(ca_detector *detector, int rotor, ca_real share)
{
    const ca_real whole = detector->announced[rotor], health = detector->health[rotor];
    ca_real left = ca_clip(health - share, 0, whole);
    left = left < USELESS * whole ? 0 : left;
    ca_real given[6], error[6];
    for (int b = 0; b < CA_BLOCKS; b++) {
        ca_block *block = &detector->blocks[b];
        /* It may be forgotten. */
        if (!(block->length > 0))
            continue;
        signature_of(detector->model, block, rotor, 1, given, error);
        for (int k = 0; k < 6; k++)
            block->impulse[k] += (health - left) * given[k];
    }
    detector->health[rotor] = left;
}

/* The order of the next name. */
static int next_name(const ca_detector *detector)
{
    int last = 0;
    for (int i = 0; i < ROTORS(detector->model); i++)
        last = most(last, detector->order[i]);
    return last + 1;
}

static void fail(ca_detector *detector, int rotor, ca_real share, int64_t time, int order,
                 int evidence)
{
    detector->since[rotor] = time;
    detector->order[rotor] = order;
    detector->evidence[rotor] = evidence;
    detector->refined[rotor] = 0;
    reduce(detector, rotor, share);
}

/* Let both rotors of each named arm that gives nothing have failed. */
static void close_arms(ca_detector *detector)
{
    for (int i = 0; i < ROTORS(detector->model); i++)
        if (detector->arm[i] && !(level_of(detector, i) > 0)) {
            const int partner = partner_of(detector->model, i);
            detector->arm[i] = detector->arm[partner] = 0;
            detector->probabilities[i] = detector->probabilities[partner] = CERTAIN;
        }
}

/* Estimate the health of rotors that have just failed, the young ones; return whether it changes. */
static int refine(ca_detector *detector, const finding *found, const int *young)
{
    int changed = 0;
    for (int i = 0; i < ROTORS(detector->model); i++)
        if (young[i] && detector->health[i] > 0 &&
            ca_abs(found->shares[i]) > ca_max(CA_REAL(0.05), 3 * found->errors[i])) {
            reduce(detector, i, (detector->arm[i] ? CA_REAL(0.5) : 1) * found->shares[i]);
            changed = 1;
        }
    close_arms(detector);
    return changed;
}

/* Let a rotor that was found to have failed be sound. */
static void give_back(ca_detector *detector, int rotor)
{
    reduce(detector, rotor, detector->health[rotor] - detector->announced[rotor]);
    detector->refined[rotor] = CA_UNBOUNDED;
    detector->since[rotor] = 0;
    detector->order[rotor] = 0;
    detector->evidence[rotor] = CA_NONE;
    detector->probabilities[rotor] = 0;
}

/* Give back the rotors whose failure has just explained what two others lack. */
static void give_back_between(ca_detector *detector, const finding *found)
{
    for (int i = 0; i < ROTORS(detector->model); i++) {
        int named = detector->arm[i];
        for (int k = 0; k < found->names; k++)
            named |= found->named[k] == i;
        if (!named && detector->refined[i] < REFINED && detector->evidence[i] == CA_MOTION)
            give_back(detector, i);
    }
}

/* Give back the partners of the rotors that are named: they may just have been named for these.
 * If both have failed, the motion names them again. */
static void give_back_partners(ca_detector *detector, const finding *found)
{
    for (int k = 0; k < found->names; k++) {
        const int partner = partner_of(detector->model, found->named[k]);
        if (found->open[k] || partner < 0 || detector->arm[partner])
            continue;
        int named = 0;
        for (int i = 0; i < found->names; i++)
            named |= found->named[i] == partner;
        if (!named && detector->evidence[partner] == CA_MOTION && detector->refined[partner] < TOLD)
            give_back(detector, partner);
    }
}

/* Let one rotor of a named arm have failed, and the other one be sound. */
static void tell(ca_detector *detector, int failed, int sound)
{
    const ca_real lost = detector->announced[failed] - detector->health[failed];
    detector->arm[failed] = detector->arm[sound] = 0;
    reduce(detector, failed, lost);
    give_back(detector, sound);
    detector->probabilities[failed] = CERTAIN;
}

/* Tell which rotor of a new arm has failed, where it shows; return whether the health changes. */
static int tell_arms(ca_detector *detector, const ca_block *windows,
                     const ca_real variance[CA_WINDOWS][6])
{
    int changed = 0;
    ca_real evidence[CA_N] = {0};
    for (int t = 0; t < CA_WINDOWS; t++)
        compare_arms(detector, &windows[t], variance[t], evidence);
    for (int i = 0; i < ROTORS(detector->model); i++) {
        const int partner = partner_of(detector->model, i), count = detector->upper[i];
        const int upper = evidence[i] > TELLING, lower = evidence[i] < -TELLING;
        if (!detector->arm[i] || partner < i || !(detector->refined[i] < TOLD))
            continue;
        detector->upper[i] = upper ? most(count, 0) + 1 : lower ? -most(-count, 0) - 1 : 0;
        if (detector->upper[i] < IN_A_ROW && -detector->upper[i] < IN_A_ROW)
            continue;
        tell(detector, upper ? i : partner, upper ? partner : i);
        changed = 1;
    }
    return changed;
}

/* Learn the drag about the mean motion from the shortest window. */
static void learn_motion(ca_detector *detector, const ca_block *window, const ca_real *mean)
{
    const ca_real share =
        settled(window->length / ca_min(CA_REAL(2.5) * LEARNING, detector->flown));
    /* The mean disturbance in the body frame is no part of what the window lacks. */
    ca_real steady[6];
    ca_copy(6, detector->estimate, steady);
    rotate_back((const ca_real(*)[3])detector->rotation, steady);
    for (int k = 0; k < 6; k++) {
        ca_real moment[4];
        for (int j = 0; j < 4; j++)
            moment[j] = detector->moments[j][k];
        const ca_real moved = mean[k] - moment[1];
        const ca_real force =
            window->impulse[k] / window->length + steady[k] + detector->drag[k] * moved;
        const ca_real now[4] = {force, mean[k], (force - moment[0]) * moved, moved * moved};
        for (int j = 0; j < 4; j++)
            detector->moments[j][k] = moment[j] + share * (now[j] - moment[j]);
        detector->drag[k] = ca_min(
            detector->moments[2][k] / (detector->moments[3][k] + CA_REAL(0.0025)), 0);
    }
}

/* Learn what is usual, once in the time of the shortest window, unless a failure is suspected. */
static void learn(ca_detector *detector, ca_real block, ca_real spread[CA_WINDOWS][6],
                  const ca_block *windows, const ca_real *thrusts, int moving)
{
    ca_real mean[6];
    detector->unlearnt += block;
    if (detector->unlearnt < LEARNT * WINDOWS[0])
        return;
    detector->unlearnt = 0;
    for (int k = 0; k < 6; k++)
        mean[k] = CA_REAL(0.5) * (detector->learnt[k] + detector->motion[k]);
    ca_copy(6, detector->motion, detector->learnt);
    if (suspicious(detector))
        return;
    for (int h = 0; h < 2; h++) {
        const ca_real share =
            settled(windows->length * learning_gain(detector, h ? LONG_LEARNING : LEARNING));
        for (int t = 0; t < CA_WINDOWS; t++)
            for (int k = 0; k < 6; k++) {
                const ca_real square = windows[t].impulse[k] * windows[t].impulse[k];
                ca_real *variance = &detector->variance[h][t][k];
                *variance += share * (ca_min(square, OUTLIER * spread[t][k]) - *variance);
            }
    }
    const ca_real quick = settled(windows->length * learning_gain(detector, LEARNING));
    for (int i = 0; i < ROTORS(detector->model); i++)
        detector->mean_thrusts[i] += quick * (thrusts[i] - detector->mean_thrusts[i]);
    if (moving)
        learn_motion(detector, windows, mean);
}

/* A window ends where its length is reached within half a block. */
static void sum_windows(ca_detector *detector, ca_block *windows)
{
    const int n = ROTORS(detector->model);
    ca_block sum;
    memset(&sum, 0, sizeof sum);
    for (int t = 0, b = 0; t < CA_WINDOWS; t++) {
        for (; b < CA_BLOCKS; b++) {
            const ca_block *block = block_of(detector, b);
            if (b && sum.length + HALF * block->length >= WINDOWS[t])
                break;
            sum.length += block->length;
            for (int k = 0; k < 6; k++)
                sum.impulse[k] += block->impulse[k];
            for (int k = 0; k < 2; k++)
                sum.lateral[k] += block->lateral[k];
            sum.total += block->total;
            for (int i = 0; i < n; i++) {
                sum.given[i] += block->given[i];
                sum.change[i] += block->change[i];
            }
        }
        detector->windows[t] = b;
        windows[t] = sum;
    }
}

/* Add the variance by errors of the thrusts, the lag and the delay, of each rotor and of all. */
static void add_model_errors(const ca_detector *detector, const ca_block *windows,
                             ca_real variance[CA_WINDOWS][6])
{
    const ca_detector_model *model = detector->model;
    const ca_real common = COMMON_ERROR * (model->time_constant + model->delay);
    for (int t = 0; t < CA_WINDOWS; t++) {
        ca_real change[6] = {0};
        for (int i = 0; i < ROTORS(model); i++) {
            const ca_real usual = windows[t].length * detector->mean_thrusts[i];
            const ca_real by_thrust = THRUST_ERROR * (windows[t].given[i] - usual);
            const ca_real by_time = TIME_ERROR * windows[t].change[i];
            const ca_real error = by_thrust * by_thrust + by_time * by_time;
            for (int k = 0; k < 6; k++) {
                variance[t][k] += error * (model->wrenches[k][i] * model->wrenches[k][i]);
                change[k] += model->wrenches[k][i] * windows[t].change[i];
            }
        }
        for (int k = 0; k < 6; k++)
            variance[t][k] += common * common * (change[k] * change[k]);
    }
}

/* Add the variance by the trim, which is unknown in the beginning, but for a flight from rest. */
static void add_trim(const ca_detector *detector, const ca_block *windows,
                     ca_real variance[CA_WINDOWS][6])
{
    const ca_real share = TRIM * (1 - detector->flown / LEARNING);
    if (detector->rested || !(share > 0))
        return;
    for (int t = 0; t < CA_WINDOWS; t++) {
        const ca_real error = share * windows[t].length;
        for (int k = 0; k < 6; k++)
            variance[t][k] += error * error * detector->model->disturbance[0][k];
    }
}

/* Add the variance of what named arms lack, since which rotor has failed is unknown. */
static void add_unknown(const ca_detector *detector, const ca_block *windows,
                        ca_real variance[CA_WINDOWS][6])
{
    const ca_detector_model *model = detector->model;
    for (int i = 0; i < ROTORS(model); i++) {
        const ca_real lost = detector->announced[i] - detector->health[i];
        ca_real given[6], others[6], error[6];
        if (!detector->arm[i] || partner_of(model, i) < i)
            continue;
        for (int t = 0; t < CA_WINDOWS; t++) {
            signature_of(model, &windows[t], i, 1, given, error);
            signature_of(model, &windows[t], partner_of(model, i), 1, others, error);
            for (int k = 0; k < 6; k++) {
                const ca_real apart = lost * (given[k] - others[k]);
                variance[t][k] += apart * apart;
            }
        }
    }
}

/* Set the probabilities of a disturbance, and of the loss of each rotor that has not failed yet. */
static void set_probabilities(ca_detector *detector, const finding *found, ca_real score)
{
    const int n = ROTORS(detector->model);
    ca_real total = 1 - settled(score);
    const ca_real disturbance = 1 - settled(score - found->disturbance);
    total += disturbance;
    for (int i = 0; i < n; i++)
        total += 1 - settled(score - found->evidence[i]);
    detector->probabilities[n] = disturbance / total;
    for (int i = 0; i < n; i++)
        if (!detector->order[i])
            detector->probabilities[i] = (1 - settled(score - found->evidence[i])) / total;
}

/* Whether the same rotors, and no others, were named in enough tests of a suspicion. */
static int confirmed(ca_detector *detector, const finding *found)
{
    int same = found->names == detector->names;
    if (!found->names)
        return 0;
    for (int k = 0; k < found->names; k++) {
        same = same && found->named[k] == detector->named[k] && found->open[k] == detector->open[k];
        detector->named[k] = found->named[k];
        detector->open[k] = found->open[k];
    }
    detector->names = found->names;
    detector->count = same ? detector->count + 1 : 1;
    if (detector->count < CONFIRMATIONS)
        return 0;
    detector->count = 0;
    return 1;
}

/* Test all windows that end now; return whether the health has changed. */
static int test_windows(ca_detector *detector, int64_t time, const ca_real *thrusts, int moving)
{
    const ca_detector_model *model = detector->model;
    const int n = ROTORS(model);
    const ca_real block = detector->sums.length;
    ca_block windows[CA_WINDOWS];
    ca_real spread[CA_WINDOWS][6], variance[CA_WINDOWS][6], known[CA_WINDOWS][6], greatest = 0;
    finding found;
    /* A stuck rotor is commanded less and less, so a suspicion keeps the greatest thrusts. */
    const ca_real forgotten = detector->waited > 0 ? 0 : settled(block / RECENT);
    for (int i = 0; i < n; i++) {
        const ca_real thrust = ca_abs(thrusts[i]);
        const ca_real less = forgotten * (detector->peaks[i] - thrust);
        detector->peaks[i] = ca_max(thrust, detector->peaks[i] - less);
        detector->sums.change[i] = thrusts[i] - detector->thrusts[i];
        detector->thrusts[i] = thrusts[i];
    }
    detector->newest = (detector->newest > 0 ? detector->newest : CA_BLOCKS) - 1;
    *block_of(detector, 0) = detector->sums;
    memset(&detector->sums, 0, sizeof detector->sums);
    if (detector->flown < 2 * block) {
        forget(detector, 0);
        return 0;
    }
    sum_windows(detector, windows);
    int refining = 0, arms = 0, young[CA_N], recent[CA_N];
    for (int i = 0; i < n; i++) {
        young[i] = detector->refined[i] < REFINED;
        recent[i] = detector->refined[i] < LEARNING;
        detector->refined[i] += block;
        arms |= detector->arm[i];
        /* While an arm may be told, what it lacks is not learnt. */
        refining |= young[i] || (detector->arm[i] && detector->refined[i] < TOLD);
    }
    for (int t = 0; t < CA_WINDOWS; t++) {
        ca_real sum = 0;
        for (int k = 0; k < 6; k++) {
            const ca_real impulse = windows[t].impulse[k];
            const ca_real noise = k < 3 && detector->measures_force
                                      ? model->force_noise * windows[t].length
                                      : model->noise[k];
            const ca_real learnt =
                ca_max(detector->variance[0][t][k], detector->variance[1][t][k]);
            spread[t][k] = ca_max(learnt, FLOOR * FLOOR * noise);
            variance[t][k] = spread[t][k];
            sum += impulse * impulse / spread[t][k];
        }
        greatest = ca_max(greatest, CA_REAL(0.5) * sum);
    }
    if (!(detector->rested || detector->flown >= CA_UNTESTED) ||
        (!refining && greatest <= SUSPICION)) {
        /* No score exceeds this sum. */
        clear_suspicion(detector);
        learn(detector, block, spread, windows, thrusts, moving);
        return 0;
    }
    add_model_errors(detector, windows, variance);
    add_trim(detector, windows, variance);
    if (arms) {
        memcpy(known, variance, sizeof known);
        add_unknown(detector, windows, variance);
    }
    /* A disturbance that lasts is no push: nobody owes anything. */
    if (detector->waited >= PATIENCE)
        for (int i = 0; i < n; i++)
            detector->leads[i] = ca_max(detector->leads[i], 0);
    test(detector, windows, block, (const ca_real(*)[6])variance, recent, &found);
    ca_copy(n, found.leads, detector->leads);
    ca_real score = found.disturbance;
    for (int i = 0; i < n; i++)
        score = ca_max(score, found.evidence[i]);
    if (score > SUSPICION && !moving) {
        /* A lost rotor turns the vehicle over; this one stands, and the ground carries it. */
        forget(detector, 0);
        return 0;
    }
    int changed = refine(detector, &found, young);
    changed |= arms && tell_arms(detector, windows, (const ca_real(*)[6])known);
    detector->waited = score > SUSPICION || refining ? detector->waited + block : 0;
    detector->suspect = found.evidence[found.rotor] > LIMIT ? found.rotor : -1;
    learn(detector, block, spread, windows, thrusts, moving);
    set_probabilities(detector, &found, score);
    if (!confirmed(detector, &found) && !found.lasting)
        return changed;
    forget(detector, detector->windows[found.window]);
    if (found.pair)
        give_back_between(detector, &found);
    give_back_partners(detector, &found);
    /* The window may have begun a block before the failure. */
    const ca_real age = windows[found.window].length;
    const ca_real longer = age / ca_max(age - block, block);
    const int order = next_name(detector);
    for (int k = 0; k < found.names; k++) {
        const int rotor = found.named[k];
        ca_real share = found.lost[k];
        const ca_real whole = found.open[k] && !detector->arm[rotor]
                                  ? CA_REAL(0.5) * detector->health[rotor]
                                  : detector->health[rotor];
        if (share * longer >= TOTAL * whole)
            share = whole;
        const ca_real likely = ca_max(detector->probabilities[rotor], CERTAIN);
        detector->probabilities[rotor] = found.open[k] ? CA_REAL(0.5) : likely;
        fail(detector, rotor, share, time, order, CA_MOTION);
        if (found.open[k]) {
            detector->arm[rotor] = 1;
            detector->upper[rotor] = 0;
        }
    }
    close_arms(detector);
    return 1;
}

void ca_detector_reset(ca_detector *detector)
{
    const ca_detector_model *model = detector->model;
    for (int i = 0; i < ROTORS(model); i++) {
        detector->health[i] = detector->announced[i];
        detector->probabilities[i] = 0;
        detector->since[i] = 0;
        detector->order[i] = 0;
        detector->evidence[i] = CA_NONE;
        detector->measured[i] = CA_UNBOUNDED;
        detector->slow[i] = 0;
        detector->refined[i] = CA_UNBOUNDED;
        detector->arm[i] = 0;
    }
    for (int t = 0; t < CA_WINDOWS; t++)
        for (int h = 0; h < 2; h++)
            ca_copy(6, model->noise, detector->variance[h][t]);
    memset(detector->drag, 0, sizeof detector->drag);
    memset(detector->moments, 0, sizeof detector->moments);
    detector->rested = 0;
    begin(detector);
}

void ca_detector_interrupt(ca_detector *detector)
{
    detector->interrupted = 1;
}

void ca_detector_start(ca_detector *detector, const ca_detector_model *model)
{
    memset(detector, 0, sizeof *detector);
    detector->model = model;
    ca_copy(ROTORS(model), model->health, detector->announced);
    start_observer(detector);
    start_rotors(detector);
    blind(detector);
    ca_detector_reset(detector);
}

int ca_detector_announce(ca_detector *detector, const ca_real *health)
{
    if (!within(ROTORS(detector->model), health, 0, 1))
        return -1;
    int changed = 0;
    for (int i = 0; i < ROTORS(detector->model); i++) {
        /* Whoever announces one rotor of an arm tells which one has failed. */
        const int partner = partner_of(detector->model, i);
        if (detector->arm[i] && health[i] < detector->health[i] &&
            health[partner] >= detector->health[partner]) {
            tell(detector, i, partner);
            changed = 1;
        }
    }
    for (int i = 0; i < ROTORS(detector->model); i++) {
        const ca_real before = detector->health[i];
        detector->announced[i] = health[i];
        detector->health[i] =
            detector->evidence[i] == CA_NONE ? health[i] : ca_min(before, health[i]);
        changed |= detector->health[i] < before || detector->health[i] > before;
    }
    if (changed) {
        /* When it failed is not known: the motion before shows nothing more. */
        forget(detector, 0);
        memset(&detector->sums, 0, sizeof detector->sums);
    }
    return 0;
}

static ca_real least_speed(const ca_detector *detector, int rotor)
{
    const ca_real later = ca_min(detector->least[0][rotor], detector->least[1][rotor]);
    return ca_min(later, detector->least[2][rotor]);
}

int ca_detector_measure(ca_detector *detector, int64_t time, const ca_real *speeds)
{
    const ca_detector_model *model = detector->model;
    const ca_real allowed = ca_sqrt(1 - LEAST_LOSS);
    /* Motors without commands idle. */
    const int fresh = detector->has_command && time - detector->commanded < STALE;
    const int order = next_name(detector);
    int changed = 0, slows = 0;
    if (!is_time(time) || !within(ROTORS(model), speeds, -CA_ABSURD, CA_ABSURD))
        return -1;
    if (detector->has_command && detector->commanded - time > oldest_measurement(detector))
        return 0;
    for (int i = 0; i < ROTORS(model); i++) {
        const ca_real measured = ca_abs(speeds[i]);
        const ca_real expected = least_speed(detector, i);
        const int slow = fresh && measured < allowed * expected &&
                         measured <= detector->measured[i] + CA_REAL(0.01) * expected;
        detector->measured[i] = measured;
        detector->slow[i] = slow ? detector->slow[i] + 1 : 0;
        slows += slow && !detector->order[i];
    }
    if (slows > MOST) {
        /* Commands do not arrive: the motion shows nothing either. */
        memset(detector->slow, 0, sizeof detector->slow);
        forget(detector, 0);
        memset(&detector->sums, 0, sizeof detector->sums);
    }
    for (int i = 0; i < ROTORS(model); i++) {
        if (detector->slow[i] != IN_A_ROW || !(detector->health[i] > 0))
            continue;
        const ca_real kept = detector->measured[i] / least_speed(detector, i);
        /* When it failed is not known: the motion before shows nothing more. */
        forget(detector, 0);
        memset(&detector->sums, 0, sizeof detector->sums);
        if (detector->arm[i])
            tell(detector, i, partner_of(model, i));
        detector->probabilities[i] = 1;
        fail(detector, i, (1 - kept * kept) * detector->health[i], time, order,
             CA_ROTOR_SPEED);
        changed = 1;
    }
    return changed;
}

static void rotation_of(const ca_real attitude[4], ca_real rotation[3][3])
{
    const ca_real length = ca_length(4, attitude);
    const ca_real x = attitude[0] / length, y = attitude[1] / length;
    const ca_real z = attitude[2] / length, w = attitude[3] / length;
    const ca_real rows[3][3] = {
        {1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)},
        {2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)},
        {2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)}};
    memcpy(rotation, rows, sizeof rows);
}

/* Set the wrench that rotors, weight and drag give. */
static void expect(ca_detector *detector, const ca_real turned[3][3], const ca_real *thrusts,
                   const ca_real *omega, const ca_real *drag)
{
    const ca_detector_model *model = detector->model;
    ca_real wrench[6], angular_momentum[3];
    for (int k = 0; k < 6; k++) {
        wrench[k] = drag[k];
        for (int i = 0; i < ROTORS(model); i++)
            wrench[k] += model->wrenches[k][i] * (detector->health[i] * thrusts[i]);
    }
    rotate(model->inertia, omega, angular_momentum);
    rotate(turned, wrench, detector->wrench);
    detector->wrench[2] -= model->weight;
    for (int k = 0; k < 3; k++) {
        const int next = (k + 1) % 3, last = (k + 2) % 3;
        detector->wrench[k + 3] = wrench[k + 3] - (omega[next] * angular_momentum[last] -
                                                   omega[last] * angular_momentum[next]);
    }
}

/* Set what a step adds to the momentum, by an accelerometer that is off the centre of mass. */
static void gain_momentum(const ca_detector *detector, ca_real step, const ca_real turned[3][3],
                          const ca_real *omega, const ca_real *change,
                          const ca_real *specific_force, ca_real *gained)
{
    const ca_detector_model *model = detector->model;
    const ca_real *r = model->imu;
    const ca_real along = ca_dot(3, omega, r), square = ca_dot(3, omega, omega);
    ca_real force[3];
    for (int k = 0; k < 3; k++) {
        const int next = (k + 1) % 3, last = (k + 2) % 3;
        const ca_real tangential = (change[next] * r[last] - change[last] * r[next]) / step;
        const ca_real centripetal = omega[k] * along - r[k] * square;
        force[k] = model->mass * step * (specific_force[k] - tangential - centripetal);
    }
    rotate(turned, force, gained);
    gained[2] -= model->gravity * step;
}

/* What a state is, whose numbers are sound. */
typedef struct {
    const ca_real *motion;
    ca_real rotation[3][3], world[6], momentum[6];
} state;

/* What lies between two states. */
typedef struct {
    ca_real length, thrusts[CA_N], turned[3][3], mean[6], drag[6];
    int moving;
} step;

static int is_state(int64_t time, const ca_real attitude[4], const ca_real motion[6],
                    const ca_real *specific_force)
{
    return is_time(time) && within(4, attitude, -CA_STATE_MAX, CA_STATE_MAX) &&
           within(6, motion, -CA_STATE_MAX, CA_STATE_MAX) &&
           ca_length(4, attitude) >= 1 / CA_STATE_MAX &&
           (!specific_force || within(3, specific_force, -CA_STATE_MAX, CA_STATE_MAX));
}

static void set_state(const ca_detector_model *model, const ca_real attitude[4],
                      const ca_real motion[6], state *now)
{
    now->motion = motion;
    rotation_of(attitude, now->rotation);
    rotate((const ca_real(*)[3])now->rotation, motion, now->world);
    ca_copy(3, motion + 3, now->world + 3);
    for (int k = 0; k < 3; k++)
        now->momentum[k] = model->mass * now->world[k];
    rotate(model->inertia, motion + 3, now->momentum + 3);
}

/* What came before says nothing of this state: it is long ago, or of another flight. */
static void begin_anew(ca_detector *detector, int64_t time)
{
    /* The trim is known if it was, not long ago. */
    if (time < detector->time || time - detector->time >= KEPT || !(detector->flown > LEARNING))
        blind(detector);
    if (time < detector->time) {
        start_observer(detector);
        start_rotors(detector);
    }
    lose(detector);
}

/* Set what lies between the last state and this one, and the wrench that is expected meanwhile. */
static void set_step(ca_detector *detector, int64_t time, const state *now, step *past)
{
    past->length = seconds(time - detector->time);
    advance_rotors(detector, detector->time, time, past->thrusts);
    expect_speeds(detector, time);
    for (int i = 0; i < ROTORS(detector->model); i++)
        past->thrusts[i] /= past->length;
    for (int k = 0; k < 6; k++) {
        past->mean[k] = CA_REAL(0.5) * (detector->motion[k] + now->motion[k]);
        past->drag[k] = detector->drag[k] * (past->mean[k] - detector->moments[1][k]);
        past->moving |= ca_abs(past->mean[k]) > detector->model->moving[k];
    }
    for (int k = 0; k < 3; k++)
        for (int j = 0; j < 3; j++)
            past->turned[k][j] = CA_REAL(0.5) * (detector->rotation[k][j] + now->rotation[k][j]);
    expect(detector, (const ca_real(*)[3])past->turned, past->thrusts, past->mean + 3, past->drag);
    if (detector->has_command) {
        detector->blind -= time - detector->time;
        detector->blind = detector->blind > 0 ? detector->blind : 0;
    }
}

/* Whether a flight has not begun, since the rotors carry too little of the weight. */
static int grounded(const ca_detector *detector)
{
    return !(detector->flown > 0) && detector->wrench[2] < -detector->model->balance[0];
}

/* Compare the momentum gained with what was expected; return whether this step counts. */
static int observe_step(ca_detector *detector, const state *now, const step *past,
                        const ca_real *specific_force)
{
    ca_real gained[6], gain = 0;
    /* What holds a vehicle that does not move may be the ground, which is not learnt. */
    if (past->moving && !detector->blind && detector->known && !grounded(detector))
        gain = learning_gain(detector, LEARNING);
    for (int k = 0; k < 6; k++)
        gained[k] = now->momentum[k] - detector->momentum[k];
    if (specific_force && past->length > 0) {
        ca_real change[3];
        for (int k = 0; k < 3; k++)
            change[k] = now->motion[k + 3] - detector->motion[k + 3];
        gain_momentum(detector, past->length, (const ca_real(*)[3])past->turned, past->mean + 3,
                      change, specific_force, gained);
    }
    detector->measures_force = specific_force != 0;
    if (detector->interrupted && detector->timed)
        return 0;
    return update(detector, past->length, gained, now->world, gain);
}

/* Add a step to the block. */
static void add(ca_detector *detector, const step *past)
{
    const int n = ROTORS(detector->model);
    detector->flown += past->length;
    rotate_back((const ca_real(*)[3])past->turned, detector->lacked);
    detector->sums.length += past->length;
    for (int k = 0; k < 6; k++)
        detector->sums.impulse[k] += detector->lacked[k];
    /* The drag across the axes of the rotors. */
    ca_real steady[6];
    ca_copy(6, detector->estimate, steady);
    rotate_back((const ca_real(*)[3])past->turned, steady);
    for (int k = 0; k < 2; k++)
        detector->sums.lateral[k] += past->length * (steady[k] + past->drag[k]);
    for (int i = 0; i < n; i++) {
        detector->sums.given[i] += past->length * past->thrusts[i];
        detector->sums.total += past->length * ca_abs(past->thrusts[i]);
    }
}

int ca_detector_observe(ca_detector *detector, int64_t time, const ca_real attitude[4],
                        const ca_real motion[6], const ca_real *specific_force)
{
    state now;
    step past;
    int counts = 0;
    if (!is_state(time, attitude, motion, specific_force))
        return -1;
    if (ignores(detector, time))
        return 0;
    set_state(detector->model, attitude, motion, &now);
    memset(&past, 0, sizeof past);
    if (detector->timed && (time < detector->time || time - detector->time >= GAP)) {
        begin_anew(detector, time);
    } else {
        if (detector->timed)
            set_step(detector, time, &now, &past);
        counts = observe_step(detector, &now, &past, specific_force);
    }
    detector->time = time;
    detector->timed = 1;
    detector->doubted = detector->interrupted = 0;
    ca_copy(6, now.momentum, detector->momentum);
    memcpy(detector->rotation, now.rotation, sizeof now.rotation);
    ca_copy(6, motion, detector->motion);
    if (detector->standing || detector->blind || grounded(detector)) {
        detector->rested |= detector->standing && !detector->blind;
        begin(detector);
        /* Usual in hover at rest, but not in a take-off, whose trim is not known. */
        const ca_real share = settled(past.length / REST);
        for (int i = 0; i < ROTORS(detector->model); i++)
            detector->mean_thrusts[i] += share * (past.thrusts[i] - detector->mean_thrusts[i]);
        return 0;
    }
    if (!detector->known) {
        /* The motion explains nothing, nor that before: commands were missing already. */
        forget(detector, 0);
        memset(&detector->sums, 0, sizeof detector->sums);
        return 0;
    }
    if (!counts)
        return 0;
    add(detector, &past);
    return detector->sums.length >= BLOCK &&
           test_windows(detector, time, past.thrusts, past.moving);
}

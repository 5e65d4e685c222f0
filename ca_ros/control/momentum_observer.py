"""The momentum observer: force and torque that the model lacks; whether a vehicle stands."""

from math import expm1
from operator import le

import numpy as np

from ca_ros.arrays import Array
from ca_ros.vehicle.state import GAP, cross
from ca_ros.vehicle.vehicle import Vehicle, inertia_of

MOTION = 0.05
"""Velocity [m/s] and angular velocity [rad/s] of a vehicle that moves, averaged over
`AVERAGING` s."""

AVERAGING = 0.2

REST = 0.5  # a vehicle that stands has not moved for this time [s]

FORCE, TORQUE = 0.3, 0.1
"""Without balance of this vertical force, over m g, or of this torque, over m g and the mean
distance of the rotors, a vehicle in flight moves."""


class Standing:
    """Tells from motion and wrench whether a vehicle stands.

    A vehicle stands until it moves.  It stands again if it does not move for a while and the
    wrench of its rotors is far from balance: thrust below its weight on the ground, or above it
    with motors that are off.

    - `still`: time for which the vehicle has not moved [s]; 0 if it moves
    - `limits` (4,): imbalance of vertical force and torque of a vehicle that stands [N, N m]
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self.standing, self.still = True, 0.0
        arm = np.linalg.norm(vehicle.arms, axis=1).mean()
        limits = np.array([FORCE, *3 * [TORQUE * arm]])
        self.limits = vehicle.mass * vehicle.gravity * limits
        self._motion = [0.0] * 6

    def observe(self, step: float, motion: Array, wrench: Array) -> bool:
        """Return whether the vehicle stands after a step.

        - `step`: [s]
        - `motion` (6,): velocity before angular velocity [m/s, rad/s]
        - `wrench` (6,): of rotors and weight during the step: force in the world frame before
          torque [N, N m]
        """
        share, now = min(1.0, step / AVERAGING), motion.tolist()
        self._motion = [m + share * (x - m) for m, x in zip(self._motion, now, strict=True)]
        if max(map(abs, self._motion)) > MOTION:
            self.standing, self.still = False, 0.0
        else:
            self.still += step
            unbalanced = bool((abs(wrench[2:]) > self.limits).any())
            self.standing = self.standing or (unbalanced and self.still > REST)
        return self.standing


JUMP_MAX = np.repeat([1.0, 10.0], 3)
"""Greatest changes of velocity [m/s] and angular velocity [rad/s] between two states that the
estimate uses: greater ones, as of a corrupted state, leave it as it is."""

RESTART = 2_000_000_000
"""Step back of the stamps of two states that is not a matter of reordering [ns]."""

KEEP = 1.0
"""A vehicle that stands gets back its estimate of this time [s], or twice this, before it came to
rest."""


class MomentumObserver:
    """Compares the momentum p of a vehicle with the known wrench w: dp/dt = w + d.

    w is the wrench of the rotors, the weight and the gyroscopic torque; d is what the model lacks.
    The estimate of d approaches a constant disturbance as 1 - exp(-L t) (De Luca and Mattone,
    Actuator failure detection and isolation using generalized momenta, ICRA 2003).

    A controller that subtracts the estimate from its demand has integral action.  It expects the
    attainable wrench, not its demand, so the estimate does not wind up while the demand is
    unattainable.  The detector of rotor failures (`ca_ros.detection.failure_detector`) expects the
    wrench of the commanded rotor speeds, and compares each impulse with the rotors.

    While the vehicle stands (`Standing`), the estimate does not change; it is that
    of the flight before.

    States that arrive too late, after a newer one, are ignored.

    - `gain`: L [1/s]; it may change between two states; with 0 the estimate stays
    - `time`: stamp of the last state that was not ignored [ns]
    - `ground`: whether the vehicle stands
    - `estimate` (6,): force in the world frame before torque in the body frame [N, N m]
    - `step`: time between the last two states [s]; 0 if the last one was ignored, or the vehicle
      stands
    - `lacked` (6,): the integral of d less its estimate over the last step [N s, N m s]
    """

    def __init__(self, vehicle: Vehicle, gain: float) -> None:
        self.gain = gain
        self._vehicle = vehicle
        self._weight = np.array([0.0, 0.0, vehicle.weight])
        self._inertia = inertia_of(vehicle)
        self._masses = np.diag(np.full(6, vehicle.mass))
        self._masses[3:, 3:] = self._inertia
        inertias = np.repeat([vehicle.mass, np.linalg.norm(self._inertia, 2)], 3)
        self.jump_max: list[float] = (JUMP_MAX * inertias).tolist()
        self.time: int | None = None
        self._doubtful: int | None = None
        self._interrupted = False
        self._momentum = self._wrench = np.zeros(6)
        self.ground, self._flown = Standing(vehicle), 0.0
        self.step, self.lacked = 0.0, np.zeros(6)
        self.estimate: Array = np.zeros(6)
        self._before = self._latest = self.estimate

    @property
    def standing(self) -> bool:
        """Whether the vehicle stands."""
        return self.ground.standing

    @property
    def carried(self) -> bool:
        """Whether the rotors carry the weight, or most of it."""
        return bool(self._wrench[2] >= -self.ground.limits[0])

    def observe(self, time: int, motion: Array, impulse: Array | None = None) -> None:
        """Update the estimate with a new state.

        A time for the second time, or a little earlier than the last one, changes nothing.  After
        a step back of seconds, which the next state confirms, the estimate starts again from
        zero; after such a step forward, of half a second or more, it continues.

        - `time`: [ns]
        - `motion` (6,): velocity in the world frame before angular velocity in the body frame
          [m/s, rad/s]
        - `impulse` (3,): what an accelerometer says that the velocity has gained since the last
          state, times the mass, in the world frame [N s]; by default the velocities say it
        """
        self.step = 0.0
        momentum = self._masses.dot(motion)
        step = 0 if self.time is None else time - self.time
        continues = not (self._interrupted and step > 0)
        if continues and self.time is not None and not 0 < step < GAP:
            # One state with a wrong stamp must not make those that follow too old.
            far = not -RESTART < step < GAP
            confirmed = self._doubtful is not None and abs(time - self._doubtful) < RESTART
            if not (far and confirmed):
                self._doubtful = time if far else self._doubtful
                return
            if step < 0:
                self.ground, self._flown = Standing(self._vehicle), 0.0
                self.estimate = self._before = self._latest = np.zeros(6)
        elif continues:
            gained = momentum - self._momentum
            if impulse is not None:
                gained[:3] = impulse
            self._update(step / 1e9, gained, motion)
        self.time, self._doubtful, self._momentum = time, None, momentum
        self._interrupted = False

    def _update(self, step: float, gained: Array, motion: Array) -> None:
        stood = self.standing
        known = 0.0 if stood else step
        lacked = gained - known * (self._wrench + self.estimate)
        if step and not all(map(le, abs(lacked).tolist(), self.jump_max)):
            return
        if self.ground.observe(step, motion, self._wrench) or stood:
            self.estimate = self._before if not stood else self.estimate
        else:
            self.step, self.lacked = step, lacked
            self.estimate = self.estimate - expm1(-self.gain * step) / step * lacked
            self._flown += step * (self.ground.still == 0.0)
            if self._flown > KEEP:
                self._before, self._latest, self._flown = self._latest, self.estimate, 0.0

    def interrupt(self) -> None:
        """Take the next state as one that does not continue those before; the estimate stays."""
        self._interrupted = True

    def expect(self, wrench: Array, angular_velocity: Array) -> None:
        """Set what the rotors do from this state on.

        `wrench` (6,): force in the world frame before torque in the body frame [N, N m].
        `angular_velocity` (3,): in the body frame [rad/s].
        """
        gyroscopic = cross(angular_velocity, self._inertia.dot(angular_velocity))
        self._wrench = wrench - np.concatenate([self._weight, gyroscopic])

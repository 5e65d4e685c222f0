"""PX4's messages in our frames and units: odometry, set-points, motor commands.

PX4's world is north-east-down and its body forward-right-down.  Ours are east-north-up and
forward-left-up (REP 103), so with P and F below:

    position   P p            attitude   P R F        P = [0 1 0; 1 0 0; 0 0 -1]
    velocity   (P R F)^T P v  body rates F w          F = diag(1, -1, -1)

PX4 normalises its set-points.  A thrust of -1 along z asks all motors for their greatest thrust.
Roll and pitch share one scale, with which a torque of 1 changes the motors by 1/sqrt(2) (root mean
square over all of them); a yaw of 1 changes the most affected motor by 1.  `units` derives these
scales from the vehicle as PX4 does from CA_ROTOR* (ControlAllocationPseudoInverse.cpp), so the
gains of PX4's rate loop remain right, and without saturation PX4's own allocator and ca_ros give
the same motors.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.arguments import rotor_rows
from ca_ros.arrays import Array
from ca_ros.settings import Numbers
from ca_ros.vehicle.command_bounds import CommandBounds
from ca_ros.vehicle.effectiveness import rotor_wrenches
from ca_ros.vehicle.state import rotation_matrix
from ca_ros.vehicle.thrust_curve import to_thrust
from ca_ros.vehicle.vehicle import Vehicle

NED, BODY_FRD = 1, 3  # of POSE_FRAME and VELOCITY_FRAME in VehicleOdometry
CONTROLS = 12  # ActuatorMotors.NUM_CONTROLS

FLIP = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])  # between FRD and FLU, force before torque
CT, SMALL = 6.5, 1e-3  # PX4's default of CA_ROTOR*_CT, and the share of a motor that is zero to it
APART = 20_000  # greatest difference of the samples of a thrust and its torque [us]


def world(ned: Sequence[float]) -> Array:
    """Return the east-north-up components (3,) of a vector north-east-down."""
    north, east, down = ned
    return np.array([east, north, -down], dtype=float)


def body(frd: ArrayLike) -> Array:
    """Return the forward-left-up components (3,) of a vector forward-right-down."""
    return FLIP[:3] * np.asarray(frd, dtype=float)


def attitude(q: Sequence[float]) -> Array:
    """Return the attitude x, y, z, w of the body forward-left-up in the world east-north-up.

    `q` (4,): VehicleOdometry.q: w, x, y, z of the body forward-right-down in the world
    north-east-down.
    """
    w, x, y, z = np.asarray(q, dtype=float) / np.linalg.norm(q)
    return np.sqrt(0.5) * np.array([x + y, x - y, w - z, w + z])


class State(NamedTuple):
    """A state in our frames.

    - `position` (3,): east-north-up [m]
    - `attitude` (4,): quaternion x, y, z, w, body to world
    - `velocity`, `angular_velocity` (3,): in the body frame, forward-left-up [m/s, rad/s]
    """

    position: Array
    attitude: Array
    velocity: Array
    angular_velocity: Array


def state(message: Any) -> State:
    """Return the state in a VehicleOdometry.

    Raises a ValueError if a value is unknown (NaN), or a frame is another one.
    """
    if message.pose_frame != NED:
        raise ValueError(f'pose_frame is {message.pose_frame}, expected {NED} (north-east-down)')
    if message.velocity_frame not in (NED, BODY_FRD):
        raise ValueError(
            f'velocity_frame is {message.velocity_frame}, expected {NED} (north-east-down) or '
            f'{BODY_FRD} (body, forward-right-down)'
        )
    for name in ('position', 'q', 'velocity', 'angular_velocity'):
        if not np.isfinite(getattr(message, name)).all():
            raise ValueError(f'{name} is unknown')
    rotation = attitude(message.q)
    if message.velocity_frame == NED:
        velocity = rotation_matrix(rotation).T @ world(message.velocity)
    else:
        velocity = body(message.velocity)
    return State(
        world(message.position), rotation, velocity, body(message.angular_velocity)
    )


def units(vehicle: Vehicle) -> Array:
    """Return what set-points of 1 stand for (6,): force [N] before torque [N m], as magnitudes.

    Raises a ValueError if the rotors cannot command them.
    """
    full = vehicle.intact.thrusts(vehicle.speed_max)
    shares = np.linalg.pinv(FLIP[:, None] * rotor_wrenches(vehicle) * (CT * full / full.max())).T

    def mean(row: Array, small: float) -> float:
        return float(row[row > small].mean()) if (row > small).any() else 0.0

    x, y, z = (mean(np.abs(row), float(np.finfo(np.float32).eps)) for row in shares[:3])
    level = max(np.sqrt(2.0 * mean(row**2, SMALL**2)) for row in shares[3:5])
    scales = np.array([x or z, y or z, z, level, level, shares[5].max()])
    if not (scales > 0.0).all():
        raise ValueError('the rotors cannot command thrust, roll or pitch, and yaw')
    return np.asarray(full.max() / CT / scales)


def wrench(thrust: Sequence[float], torque: Sequence[float], unit: Array) -> Array:
    """Return a wrench (6,), force before torque [N, N m], forward-left-up.

    `thrust, torque` (3,): VehicleThrustSetpoint.xyz and VehicleTorqueSetpoint.xyz, normalised,
    forward-right-down; `unit` (6,): see `units`.  Raises a ValueError if one is not finite.
    """
    given = np.array([*thrust, *torque], dtype=float)
    if not np.isfinite(given).all():
        raise ValueError(f'set-points {given}: expected finite numbers')
    return FLIP * unit * given


class Motors:
    """Converts rotor speeds to what PX4 gets.

    PX4's output x follows from the control c that it is sent by c = F x^2 + (1 - F) x, with its
    parameter F = THR_MDL_FAC, so PX4 models thrust as this function of x.

    - `order`: for each motor the rotor that it is, see `rotor_rows`
    - `output` ('thrust' or 'throttle'): the control is the share of the greatest thrust, for which
      PX4 finds the output; or the c whose x is the throttle of the vehicle's thrust curve
    - `thrust_factor`: THR_MDL_FAC as it is set in PX4, for 'throttle'
    """

    def __init__(
        self, vehicle: Vehicle, order: Numbers, output: str, thrust_factor: float
    ) -> None:
        self._vehicle, self._rows = vehicle, rotor_rows(order, vehicle.n, 'px4.order')
        self._thrusts, self._factor = output == 'thrust', thrust_factor
        # The allocator rounds within the bounds: see `Vehicle.speeds`.
        self._bounds = CommandBounds(vehicle, rounding=0.0)
        self._greatest = vehicle.curve.thrust(vehicle.speed_max)
        full = vehicle.intact.thrusts(vehicle.speed_max)
        self._forces = FLIP[:3] * (full[:, None] / full.sum()) * vehicle.rotor_axes

    def convert(self, speeds: Array) -> tuple[Any, Any]:
        """Return ActuatorMotors.control (12,) and VehicleThrustSetpoint.xyz (3,), float32.

        A control of NaN, which stops a motor, is that of a rotor at speed zero, and of motors that
        are not there.  The force is forward-right-down, and normalised by the sum of the greatest
        thrusts, so that of upright rotors is (0, 0, -1) at most.  Raises a ValueError if a speed
        is out of bounds.

        `speeds` (n,): in the order of the vehicle's parameter file [rad/s]
        """
        vehicle = self._vehicle
        if fault := self._bounds.fault(speeds):
            raise ValueError(fault[1])
        # With more than the nominal voltage, the allocator's speeds can be beyond full throttle.
        found = np.minimum(vehicle.curve.thrust(speeds) / self._greatest, 1.0)
        force = found @ self._forces
        if not self._thrusts:
            found = to_thrust(vehicle.throttles(speeds), self._factor)
        control: Any = np.full(CONTROLS, np.nan, dtype=np.float32)
        control[: vehicle.n] = np.where(speeds == 0.0, np.nan, found)[self._rows]
        return control, force.astype(np.float32)

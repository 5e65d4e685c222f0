"""The plant: a rigid body with motors, wind, ground and sensors, step by step."""

from __future__ import annotations

from dataclasses import replace
from math import hypot

import numpy as np

from ca_ros.arrays import Array
from ca_ros.detection.detector_settings import ImuSettings
from ca_ros.settings import ParameterError
from ca_ros.simulation.drag import Drag, Wind
from ca_ros.simulation.plant_settings import PlantSettings
from ca_ros.simulation.rigid_body import Integrator, RigidBody, euler
from ca_ros.simulation.rotor_failures import RotorFailures
from ca_ros.simulation.sensors import Accelerometer, Sensors, delay_line
from ca_ros.vehicle.motor_lag import ServoLag, lagged, mean_speeds
from ca_ros.vehicle.settings import triple
from ca_ros.vehicle.state import ANGULAR_VELOCITY, POSITION, VELOCITY
from ca_ros.vehicle.validation import repeated
from ca_ros.vehicle.vehicle import Vehicle

MEASURED = ('position', 'velocity', 'attitude', 'angular_velocity')  # as in a state

GUST_TIME = 1.0  # correlation time of the gusts [s]


def body_of(vehicle: Vehicle, settings: PlantSettings) -> RigidBody:
    """Return the rigid body of a vehicle with the mismatch and the drag of the settings.

    Its mass and its rotors' coefficients are those of the vehicle times the factors.  The bounds
    of the rotor speeds stay, so the bounds of the thrusts change.  Raises a ParameterError if the
    vehicle has no inertia, or not one factor for each rotor.
    """
    thrust = repeated('simulator.thrust_factor', settings.thrust_factor, vehicle.n)
    torque = repeated('simulator.torque_factor', settings.torque_factor, vehicle.n)
    simulated = replace(
        vehicle, mass=vehicle.mass * settings.mass_factor,
        thrust_coefficient=vehicle.thrust_coefficient * thrust,
        thrust_coefficient_reverse=vehicle.thrust_coefficient_reverse * thrust,
        torque_coefficient=vehicle.torque_coefficient * torque,
    )
    drag = Drag(triple(settings.linear_drag), settings.rotor_drag, settings.rotational_drag)
    return RigidBody(simulated, drag if drag.takes_wind or drag.rotational else None)


class Plant:
    """The simulated vehicle; holds its state.

    Each step has equal sub-steps, in which the mean rotor speeds and the wind are held.  The plant
    starts at rest: its rotors stand still.  Raises a ParameterError if settings contradict each
    other; they are named.

    `settings`: all effects are off by default.  `state` (13,): initial state, see
    `ca_ros.simulation.rigid_body`; by default that of the settings.  `integrate`: what takes a
    sub-step.  `imu`: an accelerometer, if it is given and has a place.

    - `body`: the body that moves; setting it replaces the one with which flights start, on which
      the failures act that are due
    - `failures`: a `RotorFailures`; may be replaced between two steps
    - `time_step` and `time_step_ns`: [s] and [ns]
    - `elapsed`: time of the flight, of the steps since the start [ns]
    - `state` (13,): the true state
    - `measured` (13,): the state as it is measured: late, and with noise and bias
    - `specific_force` (3,): what the accelerometer measures, in the mean of the step, as late as
      the state [m/s^2]; None without one
    - `speeds` (n,): the true rotor speeds [rad/s], and after them the servo angles [rad], if there
      are any
    """

    def __init__(
        self, body: RigidBody, settings: PlantSettings | None = None, state: Array | None = None,
        integrate: Integrator = euler, imu: ImuSettings | None = None,
    ) -> None:
        settings = PlantSettings() if settings is None else settings
        self._settings, self._imu, self.elapsed = settings, imu, 0
        self._start = self._body = body
        self.failures = RotorFailures.read(settings.failures)
        self.time_step_ns = round(settings.time_step * 1e9)
        self.time_step = self.time_step_ns / 1e9
        self._sub_steps = settings.sub_steps
        self._sub_step = self.time_step / self._sub_steps
        self._integrate = integrate
        self.state = initial_state(settings) if state is None else state
        self._grounded = settings.ground == 'flat'
        if self._grounded and self.state[POSITION][2] < 0.0:
            raise ParameterError(
                f'simulator.ground: the vehicle starts below it, at z = {self.state[2]:g} m')
        gusts, noise, shaken = np.random.default_rng(settings.seed).spawn(3)
        wind = triple(settings.wind), triple(settings.gust_intensity), GUST_TIME
        self._wind = Wind(*wind, gusts)
        windy = self._wind.mean.any() or self._wind.intensity.any()
        if windy and not (body.drag and body.drag.takes_wind):
            raise ParameterError(
                'simulator.wind and simulator.gust_intensity act through the drag: set '
                'simulator.linear_drag or simulator.rotor_drag'
            )
        self._servos = ServoLag(settings.servo_time_constant, settings.servo_rate, body.vehicle)
        self.speeds = np.concatenate(self._servos.resting)
        self._commands, self._states = (
            delay_line(f'simulator.{name}', getattr(settings, name), self._sub_step, first)
            for name, first in (('command_delay', self.speeds), ('state_delay', self.state))
        )
        deviation, bias = (
            np.concatenate([triple(getattr(settings, f'{part}_{kind}')) for part in MEASURED])
            for kind in ('noise', 'bias')
        )
        self._sensors = Sensors(deviation, bias, noise)
        self._late = [self.state, self.state]
        self._accelerometer: Accelerometer | None = None
        self.specific_force: Array | None = None
        if imu is not None and imu.has_imu:
            place, gravity = triple(imu.imu_position), body.vehicle.gravity
            self._accelerometer = Accelerometer(
                place, imu.specific_force_noise, gravity, shaken,
                triple(settings.specific_force_bias), settings.vibration, body.vehicle.n)
        self.measure()

    def restarted(self, state: Array | None = None) -> Plant:
        """Return a plant with the same body and settings in the initial state, or another."""
        plant = Plant(self._start, self._settings, state, self._integrate, self._imu)
        plant.failures = self.failures
        return plant

    @property
    def body(self) -> RigidBody:
        """The body that moves."""
        return self._body

    @body.setter
    def body(self, body: RigidBody) -> None:
        self._start = body
        self._fail()

    @property
    def failures(self) -> RotorFailures:
        """The failures of the flight."""
        return self._failures

    @failures.setter
    def failures(self, failures: RotorFailures) -> None:
        self._failures = self.checked(failures)
        self._fail()

    def checked(self, failures: RotorFailures) -> RotorFailures:
        """Return failures that the vehicle can have; raise a ParameterError for others."""
        try:
            failures.check(self._start.vehicle)
        except ParameterError as error:
            raise ParameterError(f'simulator.failures: {error}') from None
        return failures

    def _fail(self) -> None:
        """Let the rotors fail that are due, and no others."""
        vehicle = self._failures.after(self._start.vehicle, self.elapsed)
        sound = vehicle is self._start.vehicle
        self._body = self._start if sound else self._start.with_vehicle(vehicle)
        self._due = [time for time in self._failures.times if time > self.elapsed]

    def step(self, command: Array) -> Array:
        """Take a step with rotor speeds (n,) [rad/s]; return the measured state (13,).

        Raises a FloatingPointError if the vehicle tumbles so fast that the steps diverge; the
        state stays.
        """
        if self._due and self._due[0] <= self.elapsed:
            self._fail()
        self.elapsed += self.time_step_ns
        state, step, n = self.state, self._sub_step, self.body.vehicle.n
        late = self._late[-1:]
        for _ in range(self._sub_steps):
            self._commands.append(command)
            given = self._commands.popleft()
            lag = self._settings.motor_time_constant
            # The speeds at the end of the sub-step would act half of it too early.
            mean = mean_speeds(lag, self.speeds[:n], given[:n], step)
            speeds = lagged(lag, self.speeds[:n], given[:n], step)
            angles = self._servos.move(self.speeds[n:], given[n:], step, self.body.vehicle)
            self.speeds, held = (np.concatenate([each, angles]) for each in (speeds, mean))
            if self._settings.lost_rotors == 'stop':
                lost = np.flatnonzero(self.body.vehicle.lost)
                self.speeds[lost] = held[lost] = 0.0
            state = self.body.step(state, held, step, self._wind(step), self._integrate)
            if self._grounded:
                state = stopped_by_ground(state)
            self._states.append(state)
            late.append(self._states.popleft())
        self.state, self._late = state, late
        return self.measure()

    def measure(self) -> Array:
        """Measure the state with new noise, as each step does; return the measured state (13,)."""
        self.measured = self._sensors(self._late[-1])
        if self._accelerometer is not None:
            vehicle = self.body.vehicle
            self.specific_force = self._accelerometer(
                self._late, self._sub_step, self.speeds[:vehicle.n], vehicle.speed_max)
        return self.measured


def initial_state(settings: PlantSettings) -> Array:
    """Return the initial state (13,) of the settings."""
    attitude = np.array(settings.initial_attitude, dtype=float)
    return np.concatenate(
        [
            triple(settings.initial_position), triple(settings.initial_velocity),
            attitude / hypot(*attitude.tolist()), triple(settings.initial_angular_velocity),
        ]
    )


def stopped_by_ground(state: Array) -> Array:
    """Return a state (13,) after contact with the plane z = 0, where the ground is.

    The contact is an inelastic stop of the centre of mass with full friction: a vehicle that is
    below the plane, or on it and not rising, is put at rest on the plane, and its attitude stays.
    It leaves the plane as soon as the thrust exceeds the weight.
    """
    if state[POSITION][2] > 0.0 or (state[POSITION][2] == 0.0 and state[VELOCITY][2] > 0.0):
        return state
    stopped = np.array(state)
    stopped[POSITION][2] = 0.0
    stopped[VELOCITY] = stopped[ANGULAR_VELOCITY] = 0.0
    return stopped

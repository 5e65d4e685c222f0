"""The plant: a rigid body with motors, wind, ground and sensors, step by step."""

from __future__ import annotations

from collections.abc import Mapping
from math import hypot
from typing import Any

import numpy as np

from ca_ros.allocation.option_values import whole
from ca_ros.arrays import Array
from ca_ros.flight.delay import Delay, delay_steps
from ca_ros.flight.drag import Drag
from ca_ros.flight.ground import stopped_by_ground
from ca_ros.flight.integrators import INTEGRATORS
from ca_ros.flight.mismatch import mismatched
from ca_ros.flight.motor_lag import MotorLag
from ca_ros.flight.parameters import MEASURED, SIMULATION, triple
from ca_ros.flight.rigid_body import ATTITUDE, POSITION, RigidBody
from ca_ros.flight.sensors import Sensors
from ca_ros.flight.wind import Wind
from ca_ros.schema import ParameterError, complete
from ca_ros.vehicle.vehicle import Vehicle


def body_of(vehicle: Vehicle, given: Mapping[str, Any]) -> RigidBody:
    """Return the rigid body of a vehicle with the mismatch and the drag of its parameters.

    Raises
    ------
    ParameterError
        If a parameter is wrong, or the vehicle has no inertia.
    """
    p: dict[str, Any] = complete(given, SIMULATION)
    linear = triple(p, 'simulator.linear_drag')
    rotor, rotational = p['simulator.rotor_drag'], p['simulator.rotational_drag']
    dragged = linear.any() or rotor or rotational
    drag = Drag(linear, rotor, rotational) if dragged else None
    return RigidBody(mismatched(vehicle, p), drag)


class Plant:
    """The simulated vehicle; holds its state.

    Each step has equal sub-steps, in which rotor speeds and wind are held.  The plant starts at
    rest: its rotors stand still.

    Parameters
    ----------
    body : RigidBody
    given : mapping, optional
        Parameters ``simulator.*`` by name; all effects are off by default.
    state : (13,) array, optional
        Initial state, see `ca_ros.flight.rigid_body`; by default that of the parameters.

    Raises
    ------
    ParameterError
        If a parameter is wrong; it is named.

    Attributes
    ----------
    body : RigidBody
        May be replaced between two steps, for instance by one with other rotor health.
    time_step, time_step_ns : float, int
        [s] and [ns]
    state : (13,) array
        The true state.
    measured : (13,) array
        The state as it is measured: late, and with noise and bias.
    speeds : (n,) array
        The true rotor speeds [rad/s].
    """

    def __init__(
        self, body: RigidBody, given: Mapping[str, Any] | None = None, state: Array | None = None
    ) -> None:
        p: dict[str, Any] = complete(given or {}, SIMULATION)
        self.body, self._parameters = body, p
        self.time_step_ns = round(p['simulator.time_step'] * 1e9)
        self.time_step = self.time_step_ns / 1e9
        self._sub_steps = whole('simulator.sub_steps', p['simulator.sub_steps'], SIMULATION)
        self._sub_step = self.time_step / self._sub_steps
        self._integrate = INTEGRATORS[p['simulator.integrator']]
        self.state = initial_state(p) if state is None else state
        self._grounded = p['simulator.ground'] == 'flat'
        if self._grounded and self.state[POSITION][2] < 0.0:
            raise ParameterError(
                f'simulator.ground: the vehicle starts below it, at z = {self.state[2]:g} m'
            )
        seed = whole('simulator.seed', p['simulator.seed'], SIMULATION)
        gusts, noise = np.random.default_rng(seed).spawn(2)
        self._wind = Wind(
            triple(p, 'simulator.wind'),
            triple(p, 'simulator.gust_intensity'),
            p['simulator.gust_time'],
            gusts,
        )
        windy = self._wind.mean.any() or self._wind.intensity.any()
        if windy and not (body.drag and body.drag.takes_wind):
            raise ParameterError(
                'simulator.wind and simulator.gust_intensity act through the drag: set '
                'simulator.linear_drag or simulator.rotor_drag'
            )
        self._lag = MotorLag(p['simulator.motor_time_constant'])
        self.speeds = np.zeros(body.vehicle.n)
        self._commands = self._delay('simulator.command_delay', self.speeds)
        self._states = self._delay('simulator.state_delay', self.state)
        self._sensors = Sensors(_errors(p, 'noise'), _errors(p, 'bias'), noise)
        self._late = self.state
        self.measure()

    def restarted(self, state: Array | None = None) -> Plant:
        """Return a plant with the same body and parameters in the initial state, or another."""
        return Plant(self.body, self._parameters, state)

    def step(self, command: Array) -> Array:
        """Take a step with rotor speeds (n,) [rad/s]; return the measured state (13,).

        Raises
        ------
        FloatingPointError
            If the vehicle tumbles so fast that the steps diverge; the state stays.
        """
        state, step = self.state, self._sub_step
        for _ in range(self._sub_steps):
            self.speeds = self._lag(self.speeds, self._commands(command), step)
            state = self.body.step(state, self.speeds, step, self._wind(step), self._integrate)
            if self._grounded:
                state = stopped_by_ground(state)
            late = self._states(state)
        self.state, self._late = state, late
        return self.measure()

    def measure(self) -> Array:
        """Measure the state with new noise, as each step does; return the measured state (13,)."""
        self.measured = self._sensors(self._late)
        return self.measured

    def _delay(self, name: str, first: Array) -> Delay[Array]:
        return Delay(delay_steps(name, self._parameters[name], self._sub_step), first)


def initial_state(parameters: Mapping[str, Any]) -> Array:
    """Return the initial state (13,) of the parameters."""
    position, velocity, omega = (
        triple(parameters, f'simulator.initial_{each}')
        for each in ('position', 'velocity', 'angular_velocity')
    )
    attitude = np.asarray(parameters['simulator.initial_attitude'], dtype=float)
    if attitude.shape != (4,) or not attitude.any():
        raise ParameterError(
            f'simulator.initial_attitude: expected a quaternion x, y, z, w, got {attitude}'
        )
    state = np.concatenate([position, velocity, attitude, omega])
    state[ATTITUDE] /= hypot(*attitude.tolist())
    return state


def _errors(parameters: Mapping[str, Any], kind: str) -> Array:
    return np.concatenate([triple(parameters, f'simulator.{part}_{kind}') for part in MEASURED])

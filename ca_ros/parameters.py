"""The parameters of a vehicle: one table, one check.

Whether ROS gives the values or a file (`parameter_files`), they pass through `complete`, so that a
fault is reported in the same words.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from math import inf, isfinite, nan
from typing import Any

from ca_ros.methods import METHODS

Value = float | str | list[float] | list[str]

REQUIRED = object()

LARGEST = 1e9
"""No number of a vehicle, in SI units, is larger; products of larger ones could overflow."""


class ParameterError(ValueError):
    """A parameter file, a parameter's name or a parameter's value is wrong."""


class MissingParameterError(ParameterError):
    """A parameter without a default is not given."""


@dataclass(frozen=True)
class Parameter:
    """What a parameter means and which values it may have.

    Attributes
    ----------
    description : str
        What it is, with its unit in brackets.
    kind : type
        `float` or `str`.
    array : bool
        Whether an array is allowed (a scalar always is).
    default : value or REQUIRED
    minimum, maximum : float
        Each number lies in [minimum, maximum], or (minimum, maximum] if `positive`.
    choices : tuple of str
        The words that may be given; any if empty.
    mutable : bool
        Whether it can be set on a running node.
    """

    description: str
    kind: type = float
    array: bool = False
    default: Any = REQUIRED
    minimum: float = -inf
    maximum: float = inf
    positive: bool = False
    choices: tuple[str, ...] = ()
    mutable: bool = False

    def range(self) -> str:
        """Say in words which values are allowed."""
        if self.choices:
            return 'one of ' + ', '.join(self.choices)
        if self.positive:
            return 'positive' if self.maximum == inf else f'in (0, {self.maximum:g}]'
        if self.minimum == -inf and self.maximum == inf:
            return 'a finite number' if self.kind is float else 'a word'
        if self.maximum == inf:
            return f'at least {self.minimum:g}'
        return f'in [{self.minimum:g}, {self.maximum:g}]'


AXES = ('force_x', 'force_y', 'thrust', 'roll', 'pitch', 'yaw')

PARAMETERS: dict[str, Parameter] = {
    'mode': Parameter(
        'realtime: the simulator follows the clock; lockstep: it steps once per command',
        str,
        default='realtime',
        choices=('realtime', 'lockstep'),
    ),
    'vehicle.name': Parameter(
        'name of the vehicle, the hardware_id of its diagnostics', str, default='multirotor'
    ),
    'vehicle.mass': Parameter('mass [kg]', positive=True),
    'vehicle.gravity': Parameter('local gravity [m/s^2]', positive=True, default=9.81),
    'vehicle.inertia': Parameter(
        'inertia about the centre of mass [kg m^2]: Jx, Jy, Jz or the matrix row by row',
        array=True,
    ),
    'vehicle.center_of_mass': Parameter(
        'centre of mass in the body frame [m]', array=True, default=[0.0, 0.0, 0.0]
    ),
    'rotors.positions': Parameter(
        'x, y, z of each rotor in the body frame, forward-left-up [m]', array=True
    ),
    'rotors.axes': Parameter(
        'direction of thrust of all rotors, or of each', array=True, default=[0.0, 0.0, 1.0]
    ),
    'rotors.spins': Parameter(
        'sense of rotation of each rotor, seen against its thrust from above',
        str,
        array=True,
        choices=('cw', 'ccw'),
    ),
    'rotors.thrust_coefficient': Parameter(
        'k_f, thrust over squared speed [kg m]', array=True, positive=True
    ),
    'rotors.torque_coefficient': Parameter(
        'k_tau, reaction torque over squared speed [kg m^2]', array=True, minimum=0.0
    ),
    'rotors.speed_min': Parameter('lower bound of the speed [rad/s]', array=True, minimum=0.0),
    'rotors.speed_max': Parameter('upper bound of the speed [rad/s]', array=True, positive=True),
    'rotors.health': Parameter(
        'thrust delivered over thrust expected: 1 sound, 0 (or below 1e-9) lost',
        array=True,
        default=1.0,
        minimum=0.0,
        maximum=1.0,
        mutable=True,
    ),
    'allocation.axes': Parameter(
        'the components of the wrench that are commanded',
        str,
        array=True,
        default=['thrust', 'roll', 'pitch', 'yaw'],
        choices=AXES,
    ),
    'allocation.method': Parameter(
        'allocation method', str, default='exact', choices=tuple(METHODS), mutable=True
    ),
    'allocation.lost_axes': Parameter(
        'refuse: do not start unless the rotors can command every axis and hover; drop: start '
        'all the same, without the lost axes (nodes always drop axes that are lost in flight)',
        str,
        default='refuse',
        choices=('refuse', 'drop'),
    ),
    'allocation.exact.policy': Parameter(
        'what the exact allocator serves for a wrench that is not attainable',
        str,
        default='prioritize',
        choices=('prioritize', 'scale', 'reject'),
        mutable=True,
    ),
    'allocation.exact.order': Parameter(
        'priorities of prioritize: groups of axes, the most important first',
        str,
        array=True,
        default=['roll pitch', 'thrust', 'yaw', 'force_x force_y'],
        mutable=True,
    ),
    'allocation.exact.reversal': Parameter(
        'what the second group of the order gives up so that no lesser axis is reversed. prevent: '
        'as much as that takes; avoid: no more than down or up to hover; allow: nothing',
        str,
        default='prevent',
        choices=('prevent', 'avoid', 'allow'),
        mutable=True,
    ),
    'allocation.exact.slack': Parameter(
        'share of a wrench, or of 1 N or 1 N m, by which it may be missed where the vehicle is '
        'symmetric but for the digits of its file',
        default=1e-9,
        minimum=0.0,
        maximum=1e-2,
        mutable=True,
    ),
    'allocation.exact.solver': Parameter(
        'where the solution begins: at the pseudo-inverse, or at the answer of OSQP',
        str,
        default='newton',
        choices=('newton', 'osqp'),
        mutable=True,
    ),
    'allocation.conventional.weight': Parameter(
        'Q of the conventional allocator, Eq. (18): q of q I, the diagonal, or the matrix by rows',
        array=True,
        default=1e-4,
        minimum=-inf,
        mutable=True,
    ),
    'allocation.conventional.reference': Parameter(
        'f_ref of the conventional allocator, Eq. (18): hover thrusts, or none (zero)',
        str,
        default='hover',
        choices=('hover', 'zero'),
        mutable=True,
    ),
    'command_timeout': Parameter(
        'time without a command after which the timeout action begins [s]',
        default=0.1,
        positive=True,
        mutable=True,
    ),
    'timeout_action': Parameter(
        'what the rotors do until commands return: idle: their least speeds; stop: stand still; '
        'hold: keep the last speeds',
        str,
        default='idle',
        choices=('idle', 'stop', 'hold'),
        mutable=True,
    ),
    'command_frame': Parameter(
        'body frame, of wrenches and body velocities; messages in another frame are dropped, '
        'those without a frame are served',
        str,
        default='base_link',
        mutable=True,
    ),
    'world_frame': Parameter(
        'frame of poses and waypoints, with the same rule', str, default='map', mutable=True
    ),
    'command_age_max': Parameter(
        'age by ROS time, or time ahead of it, beyond which a wrench is dropped; 0: none is [s]',
        default=0.0,
        minimum=0.0,
        mutable=True,
    ),
    'command_order': Parameter(
        'wrenches that are older than their predecessor: any: served; newer: dropped',
        str,
        default='any',
        choices=('any', 'newer'),
        mutable=True,
    ),
    'simulator.time_step': Parameter(
        'step of the Euler integration [s]', default=0.01, minimum=1e-5, maximum=1.0
    ),
    'simulator.real_time_factor': Parameter(
        'simulated time that passes in a second, in mode realtime; stamps follow the clock only '
        'at 1 [s/s]',
        default=1.0,
        minimum=0.01,
        maximum=10.0,
    ),
    'simulator.rotational_drag': Parameter(
        'drag torque of the turning vehicle over its squared angular velocity [N m s^2/rad^2]',
        default=0.0,
        minimum=0.0,
    ),
    'simulator.hold_at': Parameter(
        'time of the simulation at which it waits in mode lockstep, until this is set to a later '
        'time, or to 0 for none [s]',
        default=0.0,
        minimum=0.0,
        mutable=True,
    ),
    'controller.position_stiffness': Parameter(
        'position error to acceleration, x, y, z [1/s^2]', array=True, default=1.5, positive=True
    ),
    'controller.position_damping': Parameter(
        'velocity error to acceleration, x, y, z [1/s]', array=True, default=2.4, positive=True
    ),
    'controller.attitude_stiffness': Parameter(
        'attitude error to angular acceleration, x, y, z [1/s^2]',
        array=True,
        default=[60.0, 60.0, 4.0],
        positive=True,
    ),
    'controller.attitude_damping': Parameter(
        'angular velocity to angular acceleration, x, y, z [1/s]',
        array=True,
        default=[14.0, 14.0, 4.0],
        positive=True,
    ),
    'controller.speed_max': Parameter(
        'greatest speed towards the waypoint along each axis [m/s]', default=3.0, positive=True
    ),
    'controller.tilt_max': Parameter(
        'greatest commanded tilt [rad]', default=0.8, positive=True, maximum=1.5
    ),
}


def check(name: str, value: Any, table: Mapping[str, Parameter] = PARAMETERS) -> Value:
    """Return the value of a parameter, typed, or raise a `ParameterError` that names the fault."""
    parameter = table[name]
    is_array = not isinstance(value, (str, bool)) and hasattr(value, '__len__')
    if is_array and not parameter.array:
        raise ParameterError(f'{name}: expected one value ({parameter.range()}), got {len(value)}')
    if parameter.kind is float and isinstance(value, str) and value.lstrip().startswith('['):
        raise ParameterError(
            f'{name}: expected numbers, got the string {_shortened(value)}; ROS takes a list for '
            'numbers only if all have a decimal point or none has: write [0.0, 0.5, 1.0]'
        )
    if not is_array:
        return _check_entry(name, parameter, value)
    entries: Any = [_check_entry(f'{name}[{i}]', parameter, x) for i, x in enumerate(value)]
    return entries


def _check_entry(name: str, parameter: Parameter, value: Any) -> Any:
    expected = f'{name}: must be {parameter.range()}, got {_shortened(value)}'
    if parameter.kind is not float:
        if not isinstance(value, parameter.kind) or (
            parameter.choices and value not in parameter.choices
        ):
            raise ParameterError(expected)
        return value
    try:
        # YAML 1.1 reads 1e-4, without a point, as a word; ROS reads it as a number, and so do we.
        number = nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        raise ParameterError(expected) from None
    if isfinite(number) and abs(number) > LARGEST:
        raise ParameterError(f'{name}: expected a number up to {LARGEST:g}, got {number:g}')
    if (
        not isfinite(number)
        or not parameter.minimum <= number <= parameter.maximum
        or (parameter.positive and number <= 0.0)
    ):
        raise ParameterError(expected)
    return number


def _shortened(value: Any) -> str:
    """Return a value as in Python, but not more than a line of it."""
    try:
        text = repr(value)
    except (RecursionError, ValueError):
        # Such as an integer of thousands of digits.
        return f'a value of type {type(value).__name__} without end'
    return text if len(text) <= 80 else f'{text[:80]}...'


def complete(
    given: Mapping[str, Any], table: Mapping[str, Parameter] = PARAMETERS
) -> dict[str, Value]:
    """Check the given parameters of a table and add the defaults of the others.

    Raises
    ------
    ParameterError
        If a value is wrong, or a name is unknown but looks like ours.
    MissingParameterError
        If a required one is missing.
    """
    groups = {name.split('.')[0] for name in table if '.' in name}
    for name in given:
        if name not in table:
            near = get_close_matches(name, table, n=1, cutoff=0.7)
            hint = f' (did you mean {near[0]}?)' if near else ''
            # What is not like one of ours may be for another package's node.
            if near or name.split('.')[0] in groups:
                raise ParameterError(f'{name}: no such parameter{hint}')
    values = {}
    for name, parameter in table.items():
        value = given.get(name, parameter.default)
        if value is REQUIRED or value is None:
            raise MissingParameterError(f'{name}: missing; it is the {parameter.description}')
        values[name] = check(name, value, table)
    return values

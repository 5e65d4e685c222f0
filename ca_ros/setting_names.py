"""The names of settings in files and on nodes: unknown ones, and those that are no more.

A renamed one is read with a warning until the next minor version; a removed one is an error.
"""

import warnings
from collections.abc import Mapping
from difflib import get_close_matches
from typing import Any

from ca_ros.errors import shortened
from ca_ros.settings import Field, ParameterError, check

RENAMED: dict[str, tuple[str, dict[str, Any]]] = {
    'allocation.exact.thrust_deviation': ('allocation.exact.axis_reversal', {}),
    'bridge.px4_input': ('px4.interface', {'state': 'offboard'}),
    'bridge.order': ('px4.order', {}),
    'bridge.px4_output': ('px4.output', {}),
    'bridge.px4_thrust_factor': ('px4.thrust_factor', {}),
}
"""By the old name of a setting its new name, and new values for old ones."""

REMOVED = {
    'allocation.exact.axis_reversal: avoid':
        'use prevent, which keeps the sense of yaw, or allow, which keeps thrust near its demand',
    'allocation.exact.solver':
        'leave it out: exact has the same thrusts; allocation.method: osqp is OSQP alone',
    'allocation.redistributed_pseudo_inverse.iterations':
        'leave it out: the method ends after as many steps as there are rotors',
    'allocation.weighted_least_squares.gamma':
        'multiply the weights wv by the square root of gamma / 1e6',
    'allocation.weighted_least_squares.iterations':
        'leave it out: the method ends after 100 steps',
    'battery_timeout':
        'leave it out: a warning begins 5 s after the last voltage, if there was one',
    'bridge.actuators': 'examples/motor_commands.py publishes actuator_msgs/Actuators',
    'command_order':
        'leave it out: wrenches are served in any order, and counted on /diagnostics',
    'detector.certainty':
        'leave it out: a rotor is named from a probability of 0.995 on',
    'detector.false_alarms':
        'leave it out: each rotor is compared with a disturbance, and the noise is learnt',
    'detector.learning_time': 'leave it out: noise and disturbances are learnt over 2 s',
    'detector.least_loss':
        'leave it out: a rotor can be named from a loss of 30 % of its thrust on',
    'detector.thrust_error': 'leave it out: it is 10 %',
    'detector.time_error': 'leave it out: it is 10 ms',
    'publish_pwm':
        'give rotors.thrust_curve.pwm: command/pwm is then published to those who subscribe',
    'publish_throttle':
        'give rotors.thrust_curve: command/throttle is then published to those who subscribe',
    'simulator.gust_time': 'leave it out: gusts have a correlation time of 1 s',
    'simulator.hold_at':
        'leave it out: rotors fail by simulator.failures, and waypoints and announcements hold '
        'from their stamps on',
    'simulator.integrator':
        'leave it out for explicit Euler steps; simulator.sub_steps makes them smaller',
    'simulator.publish_odometry':
        'leave it out: local_position/odometry is published to those who subscribe',
}
"""By a name, or a name and a value, that is gone, what to do instead."""


def renamed(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return values by full name under their present names, with one warning of all old names."""
    values: dict[str, Any] = {}
    notes = []
    for name, value in given.items():
        new, words = RENAMED.get(name, (name, {}))
        changed = words.get(value, value) if isinstance(value, str) else value
        if (new, changed) != (name, value):
            now = f'{new}: {shortened(changed)}' if changed is not value else new
            notes.append(f'{name} is now {now}')
        values.setdefault(new, changed)
    if notes:
        warnings.warn(f'old settings: {"; ".join(notes)}', FutureWarning, stacklevel=1)
    return values


def check_given(given: Mapping[str, Any], known: Mapping[str, Field]) -> None:
    """Check the names and values of settings, given by full name, against all that are known.

    Unknown names are accepted, because they may belong to another package, unless they are similar
    to a known name or in the same group (``rotors.``).  Raises a ParameterError if a name or a
    value is wrong; the message names it.
    """
    groups = {name.split('.')[0] for name in known if '.' in name}
    for name, value in given.items():
        named = f'{name}: {value}' if isinstance(value, str) else name
        if instead := REMOVED.get(name, REMOVED.get(named)):
            raise ParameterError(f'{name}: no such parameter or value any more: {instead}')
        if name in known:
            check(name, value, known[name])
            continue
        near = get_close_matches(name, known, n=1, cutoff=0.7)
        if near or name.split('.')[0] in groups:
            hint = f' (did you mean {near[0]}?)' if near else ''
            shown = name if name.isprintable() else repr(name)
            raise ParameterError(f'{shown}: no such parameter{hint}')

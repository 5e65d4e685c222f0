"""Names of settings that are no more: what there is instead.

A renamed one is read with a warning until the next minor version; a removed one is an error.
"""

from typing import Any

RENAMED: dict[str, tuple[str, dict[str, Any]]] = {
    'bridge.px4_input': ('px4.interface', {'state': 'offboard'}),
    'bridge.order': ('px4.order', {}),
    'bridge.px4_output': ('px4.output', {}),
    'bridge.px4_thrust_factor': ('px4.thrust_factor', {}),
}
"""By the old name of a setting its new name, and new values for old ones."""

REMOVED = {
    'allocation.redistributed_pseudo_inverse.iterations':
        'leave it out: the method ends after as many steps as there are rotors',
    'allocation.weighted_least_squares.iterations':
        'leave it out: the method ends after 100 steps',
    'battery_timeout':
        'leave it out: a warning begins 5 s after the last voltage, if there was one',
    'bridge.actuators': 'examples/motor_commands.py publishes actuator_msgs/Actuators',
    'command_order':
        'leave it out: wrenches are served in any order, and counted on /diagnostics',
    'publish_pwm':
        'give rotors.thrust_curve.pwm: command/pwm is then published to those who subscribe',
    'publish_throttle':
        'give rotors.thrust_curve: command/throttle is then published to those who subscribe',
    'simulator.gust_time': 'leave it out: gusts have a correlation time of 1 s',
    'simulator.integrator':
        'leave it out for explicit Euler steps; simulator.sub_steps makes them smaller',
    'simulator.publish_odometry':
        'leave it out: local_position/odometry is published to those who subscribe',
}
"""By the name of a setting that is gone, what to do instead."""

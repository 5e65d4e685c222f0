"""The messages that pass between PX4 and ca_ros, by interface; neither rclpy nor px4_msgs here."""

from typing import Any

from ca_ros.settings import ParameterError

DIRECT = {
    'actuator_motors': ('ActuatorMotors', ('timestamp', 'timestamp_sample', 'control')),
    'vehicle_thrust_setpoint': ('VehicleThrustSetpoint', ('timestamp', 'xyz')),
}

SENT: dict[str, dict[str, tuple[str, tuple[str, ...]]]] = {
    'mode': {
        **DIRECT,
        'register_ext_component_request': (
            'RegisterExtComponentRequest',
            ('request_id', 'name', 'px4_ros2_api_version', 'register_mode'),
        ),
        'unregister_ext_component': (
            'UnregisterExtComponent', ('name', 'arming_check_id', 'mode_id')
        ),
        'config_control_setpoints': (
            'VehicleControlMode', ('source_id', 'flag_control_allocation_enabled')
        ),
        'arming_check_reply': (
            'ArmingCheckReply', ('registration_id', 'can_arm_and_run', 'mode_req_attitude')
        ),
    },
    'offboard': {
        **DIRECT, 'offboard_control_mode': ('OffboardControlMode', ('direct_actuator',))
    },
    'setpoints': {'actuator_motors': DIRECT['actuator_motors']},
}
"""By interface, what goes to ``fmu/in/NAME``: the type of the message, and fields it must have."""

HEARD: dict[str, dict[str, str]] = {
    'mode': {
        'vehicle_odometry': 'VehicleOdometry', 'vehicle_control_mode': 'VehicleControlMode',
        'vehicle_status': 'VehicleStatus',
        'register_ext_component_reply': 'RegisterExtComponentReply',
        'arming_check_request': 'ArmingCheckRequest',
    },
    'offboard': {
        'vehicle_odometry': 'VehicleOdometry', 'vehicle_control_mode': 'VehicleControlMode',
        'vehicle_status': 'VehicleStatus',
    },
    'setpoints': {
        'vehicle_thrust_setpoint': 'VehicleThrustSetpoint',
        'vehicle_torque_setpoint': 'VehicleTorqueSetpoint', 'vehicle_status': 'VehicleStatus',
    },
}
"""By interface, what comes from ``fmu/out/NAME``, with the type of the message."""


def topic(direction: str, name: str, kind: Any) -> str:
    """Return the name of a topic; PX4 appends the version of the message, unless it is 0.

    `direction`: 'in' or 'out', as PX4 sees it.
    """
    version = getattr(kind, 'MESSAGE_VERSION', 0)
    return f'fmu/{direction}/{name}' + (f'_v{version}' if version else '')


def check_messages(messages: Any, interface: str) -> None:
    """Raise a ParameterError if a message that is needed, or a field of it, is missing.

    rclpy's constructors ignore fields that a message does not have, so motors would be sent to a
    PX4 that does not take them.
    """
    needed = {**DIRECT, **SENT['offboard'], **SENT[interface]}
    fields = dict(needed.values())
    for kind in HEARD[interface].values():
        fields.setdefault(kind, ())
    for kind, names in fields.items():
        found = getattr(messages, kind, None)
        absent = [name for name in names if not hasattr(found and found(), name)]
        if found is None or absent:
            what = f'{kind} without {", ".join(absent)}' if found else f'no {kind}'
            raise ParameterError(
                f'px4_msgs has {what}: expected the px4_msgs of the branch of your PX4, which '
                'must be 1.15 or newer'
            )

"""The topics: their names, types and QoS, and which node publishes and subscribes to each.

A new topic is a line here and the calls in its nodes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import Log
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray, Header, Int8MultiArray

try:
    from visualization_msgs.msg import MarkerArray
except ImportError:
    # Only the viewer needs it.
    MarkerArray = None


@dataclass(frozen=True)
class Topic:
    """A topic: its type, the node that publishes it ('': all), and subscribers in the loop.

    The name is absolute, or relative to the namespace or to the publisher (``~/``).  A `stream`
    has one message for each step of the loop, with the stamp of the step.  An `optional` topic has
    a publisher only if a parameter asks for it or has a value for it, or if rotors tilt.
    """

    name: str
    kind: type[Any]
    publisher: str = ''
    subscribers: tuple[str, ...] = ()
    stream: bool = False
    optional: bool = False

    @property
    def path(self) -> str:
        """The name as other nodes of the namespace use it."""
        return self.name.replace('~', self.publisher)


def type_name(kind: Any) -> str:
    """Return the name of a message type in ROS, such as std_msgs/msg/Header."""
    return f'{kind.__module__.partition(".")[0]}/msg/{kind.__name__}'


WAYPOINT = Topic('command/pose', PoseStamped, 'recorder', ('controller',))
WRENCH = Topic('command/wrench', WrenchStamped, 'controller', ('allocator',), stream=True)
SPEED_COMMAND = Topic(
    'command/motor_speed', Float64MultiArray, 'allocator', ('simulator',), stream=True
)
TILT_COMMAND = Topic(
    'command/tilt_angle', Float64MultiArray, 'allocator', ('simulator',), stream=True,
    optional=True,
)
COMMAND_PARTS = SPEED_COMMAND, TILT_COMMAND
THROTTLE = Topic('command/throttle', Float64MultiArray, 'allocator', optional=True)
PWM = Topic('command/pwm', Float64MultiArray, 'allocator', optional=True)
EFFECTORS = Topic('command/effectors', Float64MultiArray, 'allocator', optional=True)
ROTOR_HEALTH = Topic(
    'rotor_health', Float64MultiArray, 'monitor', ('allocator', 'controller'), optional=True
)
HELD_HEALTH = Topic(
    'rotor_health/held', Float64MultiArray, 'allocator', ('monitor',), optional=True
)
ANNOUNCED_HEALTH = Topic(
    'rotor_health/announced', Float64MultiArray, 'recorder',
    ('allocator', 'controller', 'monitor'), optional=True,
)
MEASURED_SPEEDS = Topic('motor_speed/measured', Float64MultiArray, 'simulator', optional=True)
SPEEDS = Topic('motor_speed', Float64MultiArray, 'simulator', stream=True)
TILTS = Topic('tilt_angle', Float64MultiArray, 'simulator', stream=True, optional=True)
POSE = Topic('local_position/pose', PoseStamped, 'simulator', ('controller',), stream=True)
VELOCITY = Topic(
    'local_position/velocity_body', TwistStamped, 'simulator', ('controller',), stream=True
)
STATE_RESTART = Topic(
    'local_position/restart', Header, 'px4_bridge', ('controller', 'monitor'), optional=True
)
ODOMETRY = Topic('local_position/odometry', Odometry, 'simulator', optional=True)
CLOCK = Topic('/clock', Clock, 'simulator', optional=True)
ALLOCATED_WRENCH = Topic('~/allocated_wrench', WrenchStamped, 'allocator')
RESIDUAL = Topic('~/residual', WrenchStamped, 'allocator')
SATURATION = Topic('~/saturation', Int8MultiArray, 'allocator')
UNALLOCATED = Topic('~/unallocated', WrenchStamped, 'controller')
DIAGNOSTICS = Topic('/diagnostics', DiagnosticArray)
ROSOUT = Topic('/rosout', Log)
MARKERS = MarkerArray and Topic('~/markers', MarkerArray, 'viewer', optional=True)

EFFECTIVENESS = 'effectiveness'  # Float64MultiArray, m by n, of a problem without a vehicle
EFFECTOR_HEALTH = 'effector_health'  # as rotor_health/announced, of effectors
IMU = 'imu'  # sensor_msgs/Imu, with `detector.imu_position` alone
BATTERY = 'battery'  # sensor_msgs/BatteryState, for `rotors.speed_max_per_volt` alone

TOPICS = tuple(topic for topic in list(globals().values()) if isinstance(topic, Topic))
"""A bag records all of them."""

STREAMS = tuple(topic for topic in TOPICS if topic.stream and not topic.optional)

LINKS = tuple(topic for topic in STREAMS if topic.subscribers)  # they join the three nodes


def imu() -> Topic:
    """Return the topic `IMU`; only this imports the package of its message."""
    from sensor_msgs.msg import Imu

    return Topic(IMU, Imu)


DEPTH = 2000  # of queues that lose nothing: steps that a recorder may lag behind in lockstep


def deep() -> QoSProfile:
    """Return a reliable QoS that loses no message of `DEPTH`."""
    return QoSProfile(depth=DEPTH)


def needed(topics: Sequence[Topic], servos: int) -> Sequence[Topic]:
    """Return the topics of rotor speeds and of the angles of servos, if there are servos."""
    return topics if servos else topics[:1]


def offered(mode: str) -> QoSProfile:
    """Return the QoS of publishers: reliable, which any subscriber matches, and depth 1."""
    return deep() if mode == 'lockstep' else QoSProfile(depth=1)


def requested(mode: str) -> QoSProfile:
    """Return the QoS of subscribers of streams: the newest message, in lockstep each one."""
    if mode == 'lockstep':
        return deep()
    return QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


def standing(mode: str) -> QoSProfile:
    """Return the QoS of messages that later subscribers get, too, if they ask for it.

    A subscription that asks for it does not match publishers that do not offer it, such as that of
    ``ros2 topic pub``.
    """
    found = offered(mode)
    found.durability = DurabilityPolicy.TRANSIENT_LOCAL
    return found


COMMAND = QoSProfile(depth=1)  # of rare messages that must arrive, such as diagnostics

STANDING = standing('realtime')

GATHERED = standing('realtime')
"""QoS of subscriptions to what two publishers keep: in a queue of 1 one replaces the other."""
GATHERED.depth = 2

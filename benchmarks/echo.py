"""The echo node: what a message costs in plain rclpy, without an allocation.

It answers each command/wrench with its numbers, as many as the argument says, in the message of
command/motor_speed and with the same quality of service.
"""

import signal
import sys
from itertools import cycle, islice

import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.utilities import remove_ros_args
from std_msgs.msg import Float64MultiArray, MultiArrayDimension

from ca_ros.nodes.topics import SPEED_COMMAND, WRENCH, offered, requested


def main() -> None:
    """Answer until a signal ends the process."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: sys.exit())
    n = int(remove_ros_args(sys.argv)[1])
    rclpy.init(args=sys.argv, signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    node = Node('echo')
    speeds = node.create_publisher(Float64MultiArray, SPEED_COMMAND.name, offered('realtime'))

    def answer(command: WrenchStamped) -> None:
        stamp, force, torque = command.header.stamp, command.wrench.force, command.wrench.torque
        numbers = force.x, force.y, force.z, torque.x, torque.y, torque.z
        message = Float64MultiArray(data=list(islice(cycle(numbers), n)))
        label = f'stamp {stamp.sec * 1_000_000_000 + stamp.nanosec}'
        message.layout.dim = [
            MultiArrayDimension(label='rotor speed [rad/s]', size=n, stride=n),
            MultiArrayDimension(label=label, size=1, stride=1),
        ]
        speeds.publish(message)

    node.create_subscription(WrenchStamped, WRENCH.name, answer, requested('realtime'))
    while True:
        rclpy.spin_once(node, timeout_sec=0.1)


if __name__ == '__main__':
    main()

"""The private names of rclpy that the nodes need; no other module uses one.

- rclpy raises errors of its C++ part but does not export their names.
- An executor needs a wait set, the guard condition that wakes it, and the kind of a
  subscription's callback; rclpy exports none of these.
- rclpy has no public access to parameters that were given to a node but not declared.
"""

from collections.abc import Callable
from typing import Any

from rclpy.executors import Executor
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.subscription import Subscription

RCLError: type[Exception] = rclpy_implementation.RCLError  # such as a wrong argument

RCLInvalidROSArgsError: type[Exception] = rclpy_implementation.RCLInvalidROSArgsError

RMWError: type[Exception] = rclpy_implementation.RMWError  # such as bytes without a message

WaitSet: Callable[..., Any] = rclpy_implementation.WaitSet


def given_parameters(node: Node) -> dict[str, Parameter]:
    """Return the parameters that the arguments and `parameter_overrides` give to a node."""
    return dict(node._parameter_overrides)


def guard_condition(executor: Executor) -> GuardCondition:
    """Return the guard condition that rclpy triggers to wake an executor."""
    return executor._guard


def takes_info(subscription: Subscription) -> bool:
    """Return whether the callback takes the information about a message besides the message."""
    return subscription._callback_type is Subscription.CallbackType.WithMessageInfo

"""Wrench messages from and to numbers."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import WrenchStamped
from numpy.typing import ArrayLike
from std_msgs.msg import Header

from ca_ros.arrays import Array
from ca_ros.nodes.messages import stamp, wrench_message, wrench_numbers


def wrench(numbers: ArrayLike, time: int = 0, frame: str = '') -> WrenchStamped:
    """Return the message of a wrench (6,), force [N] before torque [N m], or of a thrust [N].

    The message has the stamp `time` [ns] and the frame `frame`.
    """
    values = np.asarray(numbers, dtype=float)
    if not values.ndim:
        values = np.array([0.0, 0.0, values, 0.0, 0.0, 0.0])
    return wrench_message(values, Header(stamp=stamp(time), frame_id=frame))


def six(message: WrenchStamped) -> Array:
    """Return the wrench (6,) of a message: force [N] before torque [N m]."""
    return np.array(wrench_numbers(message))

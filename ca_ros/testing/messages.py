"""Wrench messages from and to numbers."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import WrenchStamped
from numpy.typing import ArrayLike

from ca_ros.arrays import Array


def wrench(numbers: ArrayLike, time: int = 0, frame: str = '') -> WrenchStamped:
    """Return the message of a wrench.

    Parameters
    ----------
    numbers : (6,) array_like or float
        Force [N] and torque [N m], or the thrust alone.
    time : int
        Stamp [ns].
    frame : str
        Frame of the header.
    """
    values = np.asarray(numbers, dtype=float)
    message = WrenchStamped()
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(time, 10**9)
    f, t = message.wrench.force, message.wrench.torque
    f.x, f.y, f.z, t.x, t.y, t.z = (
        values.tolist() if values.ndim else (0.0, 0.0, values.item(), 0.0, 0.0, 0.0)
    )
    return message


def six(message: WrenchStamped) -> Array:
    """Return the wrench (6,) of a message: force [N] and torque [N m]."""
    f, t = message.wrench.force, message.wrench.torque
    return np.array([f.x, f.y, f.z, t.x, t.y, t.z])

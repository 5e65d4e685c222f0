"""The allocator node: wrenches in, rotor speeds out.

A problem without a vehicle, such as a boat or control surfaces, has effectors instead of rotors.
"""

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from std_msgs.msg import Float64MultiArray

from ca_ros.allocation import Allocation
from ca_ros.allocation.rates import WithinRates
from ca_ros.allocation.reconfiguration import ProblemReconfiguration
from ca_ros.allocation.settings import allocator_of
from ca_ros.arrays import Array, IntArray
from ca_ros.nodes import topics
from ca_ros.nodes.allocator_node import AllocatorNode
from ca_ros.nodes.belief import Belief
from ca_ros.nodes.executable import parameter_arguments, parse, run, split
from ca_ros.nodes.stream import Streams
from ca_ros.parameter_files import ProblemSettings
from ca_ros.problem.audit import Audit
from ca_ros.problem.files import read_problem
from ca_ros.problem.problem import AllocationProblem
from ca_ros.setting_names import check_given
from ca_ros.settings import ParameterError, Settings, table
from ca_ros.vehicle.files import ParameterFile, find

COMPONENTS = (
    ('force_x', 'surge'), ('force_y', 'sway'), ('force_z', 'heave', 'thrust'),
    ('torque_x', 'roll'), ('torque_y', 'pitch'), ('torque_z', 'yaw'),
)
"""The names of axes for each component of a wrench; their units are those of the problem."""


class Effectors:
    """A method for the effectors of a problem; see `ca_ros.nodes.rotors.Rotors`."""

    def __init__(self, settings: Any, report: Audit) -> None:
        self.problem = problem = report.full
        # Only failures cost axes.
        subject = report if problem.failed else problem
        self.method = allocator_of(settings.allocation, subject)
        self.rows = rows_of(self.method.problem.axes)
        self.within_rates = WithinRates(self.method)
        self.idle, self.lost = problem.clip(problem.resting_thrusts), problem.health == 0.0
        self._wrenches = np.zeros((6, problem.n))
        self._wrenches[rows_of(problem.axes)] = problem.gamma
        unit = f' [{problem.unit.strip()}]' if problem.unit else ''
        self.label = ', '.join(f'{name}{unit}' for name in problem.effector_names)
        self.n = problem.n

    def at_rest(self, action: str, last: Array) -> Array:
        """Return the effectors (n,) of a timeout action after the last ones."""
        return last if action == 'hold' else self.idle

    def produced(self, answer: Allocation) -> Array:
        """Return the components of the wrench (6,) of an answer."""
        return self._wrenches @ answer.thrusts

    def held(self, command: Array) -> tuple[Array, IntArray]:
        """Return the wrench (6,) of a command, and which effectors are at a bound."""
        return self._wrenches @ command, self.problem.saturation(command)


class ProblemBelief(Belief):
    """What a node believes of a problem: its matrix, and the health of its effectors.

    The newest sound message on `effectiveness` and on `effector_health` holds.
    """

    made_by = ProblemReconfiguration
    health_topic = topics.EFFECTOR_HEALTH
    sound, stuck = 'no effector has failed', ('effectors', 'effector {} stuck at {:g}')

    def subscribe(
        self, streams: Streams, answer: Callable[[], None], tells: bool = False
    ) -> None:
        """Subscribe to matrix and health."""
        kind, listen = Float64MultiArray, streams.listen
        listen(kind, topics.EFFECTIVENESS, self._receive_matrix, topics.STANDING)
        receive = partial(self._receive_announcement, name=topics.EFFECTOR_HEALTH)
        quality = topics.standing(self._parameters.mode.name)
        listen(kind, topics.EFFECTOR_HEALTH, receive, quality)

    def _news(self, report: Audit) -> str:
        # A matrix may change all the time.
        return f'{report.lost} {report.hovers}'

    @property
    def _faulty(self) -> bool:
        return self.audit.full.failed and not self.audit.sound

    def _receive_matrix(self, message: Float64MultiArray) -> None:
        m, n = shape = self.audit.full.gamma.shape
        sizes = *(each.size for each in message.layout.dim),
        try:
            if sizes != shape or len(message.data) != m * n or message.layout.data_offset:
                raise ParameterError(
                    f'layout of sizes {sizes} and {len(message.data)} numbers: expected {m} rows, '
                    f'one per axis, of {n} numbers, one per effector, layout.dim of sizes {shape}'
                )
            if self.current.change_matrix(np.reshape(message.data, shape)):
                self._notify()
        except ValueError as error:
            self._diagnostics.counts['refused matrices'] += 1
            self._diagnostics.warn('matrix', f'refused {topics.EFFECTIVENESS}: {error}')


class ProblemAllocatorNode(AllocatorNode):
    """Answers each command/wrench with command/effectors.

    The axes of the problem are components of the wrench, by name.  The timeout action idle puts
    the effectors to the values within their bounds that are nearest to zero; so does stop.
    """

    declared = known = ProblemSettings
    topic = topics.EFFECTORS
    belief_type, effectors_type = ProblemBelief, Effectors

    @staticmethod
    def hardware_id(settings: Any) -> str:
        """Return the name of the problem's file."""
        return Path(settings.problem).stem


def rows_of(axes: Sequence[str]) -> list[int]:
    """Return the component of the wrench, 0 to 5, that each axis is.

    Raises a ParameterError if an axis has another name, or two are the same component.
    """
    rows = {name: row for row, names in enumerate(COMPONENTS) for name in names}
    known = ', '.join('/'.join(names) for names in COMPONENTS)
    found = [rows.get(axis, -1) for axis in axes]
    if -1 in found or len({*found}) < len(found):
        given = ', '.join(axes)
        raise ParameterError(f'problem.axes: {given}: expected different ones of {known}')
    return found


def names_problem(argv: Sequence[str]) -> bool:
    """Tell whether a command line names the file of a problem; errors are reported later."""
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument('--vehicle', default='')
    try:
        vehicle = parser.parse_known_args(split(argv)[0])[0].vehicle
        content = ParameterFile(vehicle).content if '--help' not in argv else None
    except ValueError:
        return False
    return isinstance(content, Mapping) and 'problem' in content


def _problem_arguments(file: str, _: str, declared: type[Settings]) -> list[str]:
    """Return the ROS arguments that give a node the parameters in the file of a problem."""
    found = read_problem(file, AllocationProblem)
    assert found is not None
    check_given(found[1], table(declared))
    return parameter_arguments({'problem': str(find(file).resolve()), **found[1]})


def main() -> int:
    """Run the node, of a vehicle or of a problem without one."""
    about = 'Allocate command/wrench to command/motor_speed.'
    if names_problem(sys.argv[1:]):
        parse_problem = partial(parse, file_arguments=_problem_arguments)
        return run('allocator', ProblemAllocatorNode, about, parse=parse_problem)
    return run('allocator', AllocatorNode, about)

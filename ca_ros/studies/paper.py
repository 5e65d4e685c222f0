"""Table 1 of the paper, and why our numbers differ from it."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from ca_ros.parameter_files import load
from ca_ros.settings import flat

SAMPLES = 1000  # the number of samples in the paper


class Row(NamedTuple):
    """A method in the paper's Table 1: errors [N, N m] and times [s] as mean and maximum."""

    name: str
    violations: int
    force_error: tuple[float, float]
    torque_error: tuple[float, float]
    time: tuple[float, float]
    why: str


ROWS = {
    'exact': Row(
        *('proposed method', 0, (1.2e-11, 1.7e-9), (3.7e-12, 4.5e-10), (2.1e-3, 5.4e-3)),
        'The paper solves the quadratic program with quadprog to a constraint tolerance of 1e-8; '
        'here the wrench is exact to rounding.',
    ),
    'pseudo_inverse': Row(
        *('pseudo-inverse', 519, (1.7e-1, 1.1), (6.3e-2, 4.3e-1), (1.8e-5, 3.0e-4)),
        'Only the samples differ, so the numbers differ within the standard error. From this row '
        'we conclude that the paper draws uniformly by volume.',
    ),
    'conventional': Row(
        *('optimal allocation', 0, (1.1e-2, 2.0e-2), (2.3e-7, 4.1e-5), (1.3e-3, 3.0e-3)),
        'The paper gives no Q, and the f_ref of its text, hover, does not reproduce this row: '
        'Q = q 1 1^T with q = 9.1e-4 and f_ref = 0 are chosen to give its force error. The torque '
        'error comes from the tie-break between the many solutions which this Q leaves: 1e-7 N m, '
        'but up to 5e-4 N m for the samples in the outermost 0.1 % of the set, so the largest of '
        '1000 errors depends on few samples.',
    ),
    'direct': Row(
        *('direct allocation', 0, (1.2e-15, 7.1e-15), (1.2e-15, 3.6e-15), (7.3e-3, 1.5e-2)),
        'Rounding in both.',
    ),
}


def applies(found: Mapping[str, Any]) -> bool:
    """Return whether a study, as in static.json, has the paper's vehicle and sampling."""
    return found['sampling'] == 'volume' and of_the_paper(found['parameters'])


def of_the_paper(parameters: Mapping[str, Any]) -> bool:
    """Return whether parameters are those of the paper's vehicle, with any method and gains."""
    return _as_shipped(parameters, 'vehicle.', 'rotors.')


def why(found: Mapping[str, Any], method: str) -> str:
    """Return why a study's row of a method differs from the paper's."""
    shipped = _as_shipped(found['parameters'], 'allocation.conventional.')
    if method == 'conventional' and not shipped:
        return 'Q and f_ref are not those of config/hexarotor.yaml.'
    return ROWS[method].why


def _as_shipped(parameters: Mapping[str, Any], *groups: str) -> bool:
    return all(
        parameters.get(name) == value for name, value in flat(load('hexarotor')).items()
        if name.startswith(groups) or name == 'allocation.axes'
    )

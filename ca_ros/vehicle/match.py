"""Whether a recorded flight is one of the vehicle of a file."""

from dataclasses import dataclass
from itertools import product

import numpy as np

from ca_ros.settings import ParameterError
from ca_ros.vehicle.flight_fit import AXES, BLOCK, EXCITED, FlightSides, solve
from ca_ros.vehicle.formats.recording import Recording
from ca_ros.vehicle.vehicle import Vehicle

LAGS, DELAYS = (0.0, 0.02, 0.04, 0.06, 0.09), (0.0, 0.02)  # that are tried beside the set ones [s]
SHOWN = 0.2  # least correlation between what is commanded and the motion
FASTER = 1.5  # greatest angular acceleration over that which the file predicts
CARRIED = 2.5  # greatest thrust in the air over the weight; a crash has had 1.96
BLOCKS_MIN = 3  # of fewer nothing is said
GAPS_MAX = 2.0  # greatest length of a recording over that without gaps


@dataclass(frozen=True)
class Match:
    """What a flight shows of the file of a vehicle.

    - `fault`: why the file is that of another vehicle; empty if nothing shows it
    - `shown`: whether the vehicle rolls or pitches as the file predicts
    """

    fault: str = ''
    shown: bool = False


def match(
    vehicle: Vehicle, recording: Recording, lag: float, delay: float, carried: float
) -> Match:
    """Compare a flight with what the commands, which are rotor speeds [rad/s], predict of it.

    The sides are those of `identify`, and of some lags the one with the least error is taken.
    Blocks of 2 s count alike, since a vehicle that is lost tumbles by more than it flew.  In a
    closed loop the commands answer disturbances, so a motion that is smaller than the predicted
    one shows nothing; one in the other direction, or a greater one, does.

    - `lag` and `delay`: those of the file [s]
    - `carried`: the thrust in the air over the weight; nan if there is none
    """
    faults = []
    if carried > CARRIED:
        faults.append(f'in the air {100.0 * carried:.0f} % of the thrust that carries the weight')
    times = recording.times['gyro']
    start, end = recording.span
    lasting = len(times) * float(np.median(np.diff(times)))
    if not BLOCKS_MIN * BLOCK < end - start < GAPS_MAX * lasting:
        return Match('; '.join(faults))
    try:
        sides = FlightSides(vehicle, recording, measured=False)
    except ParameterError:
        return Match('; '.join(faults))
    best = np.inf, np.zeros((4, 4)), np.zeros((4, 4, 4))
    for point in {(lag, delay), *product(LAGS, DELAYS)}:
        blocks = sides.products(*point)
        moved = blocks[:, :, 3:, 3:]
        weights = np.where(moved > EXCITED, 1.0 / np.maximum(moved, EXCITED), 0.0)
        sums = (weights * blocks).sum(axis=0)
        factors, error = solve(sums)
        if error < best[0]:
            best = float(error), factors, sums
    _, factors, sums = best
    correlations = [
        float(own[0, 3] / np.sqrt(max(own[0, 0] * own[3, 3], EXCITED))) for own in sums[:3]]
    against = {name: each for name, each in zip(AXES, correlations, strict=False) if each < -SHOWN}
    if against:
        numbers = ', '.join(f'{each:.2f}' for each in against.values())
        faults.append(f'{", ".join(against)} against the commands (correlation {numbers})')
    for i, name in enumerate(AXES[:2]):
        if correlations[i] > SHOWN and factors[i, 0] > FASTER:
            faults.append(
                f'{name} with {100.0 * factors[i, 0]:.0f} % of the angular acceleration that the '
                'file predicts')
    return Match('; '.join(faults), max(correlations[:2]) > SHOWN)

"""A recorded flight through the detector: what it would have named, and when."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ca_ros.arrays import Array, BoolArray
from ca_ros.detection.acted_on import acted_on
from ca_ros.detection.detector_settings import DetectorSettings
from ca_ros.detection.failure_detector import FailureDetector, margin_of
from ca_ros.detection.kernel_detector import Detector
from ca_ros.detection.recorded_motion import Motion, held, motion_of
from ca_ros.detection.rotor_beliefs import words_of
from ca_ros.vehicle.formats.recording import Recording
from ca_ros.vehicle.plausibility import IN_AIR
from ca_ros.vehicle.state import GAP
from ca_ros.vehicle.vehicle import Vehicle

LAUNCH = 2.0  # after the ground [s]
LANDING = 1.0  # before thrust last carries a vehicle that comes to stand [s]
CARRYING = 0.9  # least share of the median thrust in the air that carries the vehicle


@dataclass(frozen=True, eq=False)
class Naming:
    """What the detector names.

    - `time`: since the beginning of the recording [s]
    - `rotors`: counted from 0
    - `arms`: see `FailureDetector.failed_arms`
    - `health`: what each is left
    - `margin`: lead of the evidence over that of a disturbance, a natural logarithm
    - `phase`: 'launch', within `LAUNCH` s after the ground, 'landing', see `landings`, or 'flight'
    - `withheld`: whether a part of it is not to be acted on, see `acted_on`
    """

    time: float
    rotors: tuple[int, ...]
    arms: tuple[tuple[int, int], ...]
    health: tuple[float, ...]
    margin: float
    phase: str
    withheld: bool = False

    @property
    def words(self) -> str:
        """The rotors, counted from 1, such as '1 or 2, 5'; see `words_of`."""
        words = words_of([rotor + 1 for rotor in self.rotors], self.arms)
        return ', '.join(words.values())


@dataclass(frozen=True, eq=False)
class Replay:
    """A replayed flight: `times` (K,) [s], `probabilities` (K, n + 1), and what was named.

    - `notes`: what is not recorded, and what took its place
    - `phases` (K,): 'ground', 'launch', 'flight' or 'landing'; see `Naming`
    - `tested` (K,): see `FailureDetector.testing`
    - `carried`: median thrust of the commands in the air, over the weight; nan without flight
    """

    times: Array
    probabilities: Array
    named: list[Naming]
    notes: list[str]
    phases: NDArray[np.str_]
    tested: BoolArray
    carried: float

    @property
    def flying(self) -> BoolArray:
        """Whether the vehicle is off the ground (K,)."""
        return np.asarray(self.phases != 'ground')

    @property
    def in_air(self) -> float:
        """Time off the ground, without gaps [s]."""
        return self._lasting(self.flying)

    @property
    def testing(self) -> float:
        """Time in which losses were tested [s]."""
        return self._lasting(self.tested)

    def _lasting(self, rows: BoolArray) -> float:
        steps = np.diff(self.times, prepend=self.times[0])
        return float(steps[np.logical_and(rows, steps < GAP / 1e9)].sum())


def replay(
    vehicle: Vehicle, recording: Recording, settings: DetectorSettings,
    motion: Motion | None = None, make: Callable[..., Detector] = FailureDetector,
) -> Replay:
    """Replay a recording, whose commands are rotor speeds [rad/s]; after a name, reset.

    - `motion`: by default `motion_of` the recording
    - `make`: makes the detector; with `make_detector` it is quicker, and margins are not known
    """
    motion = motion_of(vehicle, recording) if motion is None else motion
    detector = make(vehicle, settings)
    sent, commands = recording.times['command'], recording.values['command']
    begin, next_command = motion.times[0], 0
    probabilities = np.zeros((len(motion.times), vehicle.n + 1))
    named: list[Naming] = []
    off_ground = np.zeros(len(motion.times))
    tested = np.zeros(len(motion.times), bool)
    for i, now in enumerate(motion.times):
        time = round(1e9 * (now - begin))
        force = None if motion.force is None else motion.force[i]
        changed = detector.observe(
            time, motion.attitude[i], motion.velocity[i], motion.gyro[i], force)
        while next_command < len(sent) and sent[next_command] <= now:
            detector.command(round(1e9 * (sent[next_command] - begin)), commands[next_command])
            next_command += 1
        step = now - motion.times[i - 1] if i else 0.0
        off_ground[i] = -1.0 if detector.standing else max(off_ground[i - 1], 0.0) + step
        tested[i], probabilities[i] = detector.testing, detector.probabilities
        lost = np.flatnonzero(detector.health < vehicle.health)
        if changed and len(lost):
            margin = margin_of(detector) if isinstance(detector, FailureDetector) else np.nan
            named.append(Naming(
                float(now - begin), tuple(lost.tolist()), detector.failed_arms,
                tuple(detector.health[lost].tolist()), margin, '',
                bool(acted_on(detector).withheld)))
            detector.reset()
    commanded = held(recording, 'command', motion.times)
    thrust, flying = vehicle.thrusts(commanded).sum(axis=1), np.asarray(off_ground >= 0.0)
    phases = np.full(len(flying), 'flight', '<U7')
    phases[off_ground < LAUNCH] = 'launch'
    phases[landings(motion.times, flying, thrust)] = 'landing'
    phases[~flying] = 'ground'
    at = np.searchsorted(motion.times - begin, [each.time for each in named])
    named = [
        replace(each, phase=str(phase)) for each, phase in zip(named, phases[at], strict=True)]
    carried = float(np.median(thrust[flying])) / vehicle.weight if flying.any() else np.nan
    most = float(thrust[flying].max(initial=0.0)) / vehicle.weight
    notes = list(motion.notes)
    if flying.any() and most < IN_AIR:
        notes.append(
            f'command: in the air at most {100.0 * most:.2g} % of the thrust that carries the '
            'weight: expected rad/s; if these are rev/s, multiply them by 2 pi')
    return Replay(
        motion.times - begin, probabilities, named, notes, phases, tested, carried)


def landings(times: Array, flying: BoolArray, thrust: Array) -> BoolArray:
    """Return when a vehicle lands (K,): it comes to stand, and its thrust carries it no more.

    It is found to stand 1 to 3 s after the contact, which is not recorded.  So a landing begins
    `LANDING` s before the last thrust of `CARRYING` times the median of the flight.

    - `flying` (K,): whether it is off the ground, as the detector sees it
    - `thrust` (K,): commanded
    """
    landing = np.zeros(len(times), bool)
    for end in np.flatnonzero(np.diff(flying.astype(int)) < 0) + 1:
        carries = np.flatnonzero(thrust[:end] >= CARRYING * np.median(thrust[flying]))
        if len(carries):
            landing[:end] |= times[:end] > times[carries[-1]] - LANDING
    return np.asarray(landing & flying)

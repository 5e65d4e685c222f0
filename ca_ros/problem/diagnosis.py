"""What is probably wrong in the file of a vehicle: slips that one change would explain.

Most multirotors are symmetric: a reflection that exchanges the senses of rotation, or a rotation
that keeps them, maps the rotors to each other.  A slip in one rotor breaks all of these
symmetries, a shifted centre of mass some of them, and one change restores them.  The changes that
restore the most are the explanation.

Sound vehicles may lack symmetry, too.  So the changes are only those that undo what people write
by mistake: a sign, a missing number, a point at another digit, x and y exchanged, a sense of
rotation that leaves more rotors of one sense, a thrust far from that of the others, or a centre of
mass far from that of the rotors.  All else gets no explanation.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ca_ros.arrays import Array
from ca_ros.problem.controllability import holding_part, independent_part
from ca_ros.problem.vehicle_problem import problem_of
from ca_ros.vehicle.vehicle import Vehicle

SAME_PLACE = 0.03  # distance of a rotor from the image of another, as a share of the longest arm
SAME_AXIS = 0.05  # the same for axes of rotors, unit vectors
SAME_THRUST = 0.25  # difference of greatest thrusts of two rotors, as measured, as a share
WEAK = 0.7  # least thrust of a sound rotor over that of the others; greatest: 1 / WEAK
COAXIAL_WEAK = 0.55  # the same in the wake of another rotor
ODD_TORQUE = 5.0  # greatest torque over thrust of a sound rotor over that of the others
SLIP_MIN = 0.2  # least distance by which a slip moves a rotor, as a share of the longest arm
SHIFT_MIN = 0.1  # least shift of the centre of mass that is told, as a share of the longest arm
EXCHANGES_MAX = 8  # rotors of a vehicle up to which exchanges are tried
UPWARDS = 0.5  # least z of the axis of a rotor that points upwards
TURN_MIN = 0.3  # least rotation that maps a rotor to another [rad]; of a ring of 12 it is 0.52
TIP_SPEED_MAX = 300.0
"""Speed of the tips of the blades above which the rotor speeds seem not to be in rad/s [m/s].

That of sound is 340 m/s; the fastest racing quadrotors come to about 250 m/s by `_tip_speeds`.
"""
THRUST_OVER_DENSITY = 0.12  # usual thrust over n^2 D^4, with n in turns per second [kg/m^3]
RPM = 2.0 * np.pi / 60.0  # [rad/s]
ROTORS_MIN = 4  # with fewer rotors, any two changes would explain a third

ARM = 0.3  # usual arm of a vehicle of 1 kg [m]; arms grow with the cube root of the mass
ARM_MAX = 4.0
"""Arm of a vehicle of 1 kg above which the lengths seem not to be in metres [m].

The human-powered helicopters with four rotors, of 120 kg with their pilots, have arms of 15 m.
"""
FAR = 10.0  # least arm over all others that looks like one in another unit alone
UNITS = {'centimetres': 0.01, 'millimetres': 0.001}


def likely_unit(length: float, mass: float) -> str:
    """Return the unit in which a length of a vehicle seems to be given; empty: metres, as it is.

    The length [m] is judged by the mass [kg].
    """
    size = abs(mass) ** (1.0 / 3.0)
    if length <= ARM_MAX * max(1.0, size):
        return ''
    usual = ARM * max(size, 1e-6)
    return min(UNITS, key=lambda unit: abs(np.log(length * UNITS[unit] / usual)))


def others_within(lengths: Array, mass: float) -> float:
    """Return the second greatest of lengths (n,), if the greatest alone seems not to be in metres.

    The greatest is then more than `FAR` times as long, and the others suit the mass [kg].
    Otherwise 0 is returned.
    """
    rest = float(np.delete(lengths, lengths.argmax()).max(initial=0.0))
    return rest if FAR * rest < lengths.max() and not likely_unit(rest, mass) else 0.0


@dataclass(frozen=True)
class Cause:
    """A slip that explains what is wrong.

    - `kind`: 'spin', 'position', 'thrust', 'torque', 'centre', 'axis', 'spins', 'order', 'units'
      or 'speeds'
    - `rotors`: the rotors of which one has the slip, counted from 1; empty if it is not a rotor's
    - `text`: what is wrong and what would be right, in words
    """

    kind: str
    rotors: tuple[int, ...]
    text: str


@dataclass(frozen=True, eq=False)
class _Layout:
    """Where the rotors are, seen from above, and what they do.

    `places` (n, 2) from the centre of mass and `axes` (n, 3), `spins` (n,), `thrusts` (n,).
    """

    places: Array
    axes: Array
    spins: Array
    thrusts: Array

    def changed(self, rotor: int, **values: Array | float) -> '_Layout':
        """Return the layout with other values of a rotor."""
        parts = {name: getattr(self, name).copy() for name in self.__dataclass_fields__}
        for name, value in values.items():
            parts[name][rotor] = value
        return _Layout(**parts)


def diagnose(vehicle: Vehicle) -> tuple[Cause, ...]:
    """Return the slips that explain what is wrong with a vehicle; empty if none does.

    Rotors are taken as they would be with full health.
    """
    vehicle = vehicle.intact
    arms = np.linalg.norm(vehicle.arms, axis=1)
    arm, i = float(arms.max()), int(arms.argmax())
    if unit := likely_unit(arm, vehicle.mass):
        if rest := others_within(arms, vehicle.mass):
            return (Cause('position', (i + 1,), (
                f'rotor {i + 1} is {arm:.4g} m from the centre of mass, the others within '
                f'{rest:.4g} m: its position looks like {unit} instead of metres')),)
        return (Cause('units', (), (
            f'an arm of {arm:.4g} m for {vehicle.mass:.4g} kg: positions look like '
            f'{unit} instead of metres')),)
    return _speeds(vehicle) or _geometry(vehicle)


def _tip_speeds(vehicle: Vehicle) -> Array:
    """Return how fast the tips of the blades are at full thrust (n,) [m/s].

    The diameter is that which usual blades need for the thrust at the speed.
    """
    turns = np.abs(vehicle.speed_max) / (2.0 * np.pi)
    return np.asarray(
        np.pi * np.sqrt(turns) * (np.abs(vehicle.thrust_max) / THRUST_OVER_DENSITY) ** 0.25)


def _speeds(vehicle: Vehicle) -> tuple[Cause, ...]:
    """Return that rotor speeds look like revolutions per minute, if blades cannot be so fast."""
    tips = _tip_speeds(vehicle)
    i = int(tips.argmax())
    if tips[i] <= TIP_SPEED_MAX:
        return ()
    speed, thrust = float(vehicle.speed_max[i]), float(vehicle.thrust_max[i])
    return (Cause('speeds', tuple((np.flatnonzero(tips > TIP_SPEED_MAX) + 1).tolist()), (
        f'rotor {i + 1} gives {thrust:.4g} N at {speed:.4g} rad/s, for which blades would have to '
        f'be faster than sound: speeds look like rpm ({speed:.4g} rpm are {RPM * speed:.4g} '
        'rad/s), or thrust_coefficient is too large')),)


def _geometry(vehicle: Vehicle) -> tuple[Cause, ...]:
    """Return the slips in places, axes, spins and thrusts of the rotors."""
    # Rotors that tilt point nowhere for sure.
    up = vehicle.rotor_axes[:, 2] * ~vehicle.servos.driven
    down = np.flatnonzero(up < -UPWARDS)
    if len(down) == 1 and (np.delete(up, down) > UPWARDS).all() and vehicle.n >= ROTORS_MIN:
        rotor = int(down[0]) + 1
        return (Cause('axis', (rotor,), (
            f'rotor {rotor} points down and all others up: its axis has the wrong sign')),)
    if vehicle.weight > 0.0 and len(down) == vehicle.n and (vehicle.speed_min >= 0.0).all():
        return (Cause('axis', tuple(range(1, vehicle.n + 1)), (
            'all rotors point down, so they cannot lift: z of their axes has the wrong sign')),)
    if not (up > UPWARDS).all() or vehicle.n < ROTORS_MIN:
        return ()
    yaw_lost = 'yaw' not in independent_part(problem_of(vehicle)).axes
    if yaw_lost and abs(vehicle.spins.sum()) == vehicle.n:
        return (Cause('spins', tuple(range(1, vehicle.n + 1)), (
            'all rotors turn the same way, so nothing gives a yaw torque against their drag: '
            'half of them turn the other way')),)
    found = _broken_symmetry(vehicle) or (_exchanged(vehicle) if yaw_lost else ())
    return found + _torques(vehicle)


def _torques(vehicle: Vehicle) -> tuple[Cause, ...]:
    """Return that one rotor has a far other torque for its thrust than the others, if so."""
    ratios = vehicle.torque_coefficient / vehicle.thrust_coefficient
    usual = float(np.median(ratios))
    strange = ~((ratios > usual / ODD_TORQUE) & (ratios < ODD_TORQUE * usual))
    if not usual or strange.sum() != 1:
        return ()
    i = int(strange.argmax())
    return (Cause('torque', (i + 1,), (
        f'rotor {i + 1} gives {ratios[i] / usual:.2g} times the torque of the others for the same '
        'thrust: torque_coefficient')),)


def _holds_all(vehicle: Vehicle) -> bool:
    """Return whether no axis of a vehicle is lost; see `ca_ros.audit`."""
    return holding_part(independent_part(problem_of(vehicle))).axes == vehicle.axes


def _exchanged(vehicle: Vehicle) -> tuple[Cause, ...]:
    """Return that two rotors are exchanged, if no axis is lost after one exchange."""
    clockwise, others = (np.flatnonzero(vehicle.spins == sense).tolist() for sense in (1, -1))
    pairs = []
    for i, j in product(clockwise, others) if vehicle.n <= EXCHANGES_MAX else ():
        spins = vehicle.spins.copy()
        spins[[i, j]] *= -1.0
        if _holds_all(replace(vehicle, spins=spins)):
            pairs.append((min(i, j) + 1, max(i, j) + 1))
    if not pairs:
        return ()
    names = ', or '.join(f'{i} and {j}' for i, j in sorted(pairs))
    return (Cause('order', tuple(sorted({rotor for pair in pairs for rotor in pair})), (
        f'no yaw torque is left: the rotors {names} are exchanged, or both turn the wrong way')),)


def _broken_symmetry(vehicle: Vehicle) -> tuple[Cause, ...]:
    """Return the changes that restore the most symmetries of a vehicle that has none."""
    layout = _Layout(
        vehicle.arms[:, :2], vehicle.rotor_axes, vehicle.spins,
        np.maximum(np.abs(vehicle.thrust_max), np.abs(vehicle.thrust_min)))
    count = _symmetries(layout)
    # The centre of mass may lie on an axis of reflection, which is left then.
    changes = _shifts(layout) if count else [*_shifts(layout), *_changes(layout)]
    found: list[tuple[int, str, int, str]] = []
    for kind, rotor, text, changed in changes:
        if (restored := _symmetries(changed)) > count:
            found.append((restored, kind, rotor, text))
    most = max((count for count, *_ in found), default=0)
    best = [each for each in found if each[0] == most]
    causes = []
    for kind in dict.fromkeys(kind for _, kind, *_ in best):
        rotors = tuple(dict.fromkeys(rotor for _, one, rotor, _ in best if one == kind))
        texts = [text for _, one, _, text in best if one == kind]
        text = texts[0] if len(rotors) == 1 else _either(kind, rotors)
        causes.append(Cause(kind, tuple(rotor for rotor in rotors if rotor), text))
    return tuple(causes)


def _either(kind: str, rotors: tuple[int, ...]) -> str:
    names = f'{", ".join(map(str, rotors[:-1]))} or {rotors[-1]}'
    what = {
        'spin': 'turns the wrong way', 'position': 'has a wrong position',
        'thrust': 'has a wrong thrust_coefficient or speed_max'}[kind]
    return f'one of the rotors {names} {what}; each explains it equally well'


def _shifts(layout: _Layout) -> Iterator[tuple[str, int, str, _Layout]]:
    """Yield kind, rotor (0: none), words and layout of each change of the centre of mass."""
    longest = float(np.linalg.norm(layout.places, axis=1).max())
    centre = (layout.places.max(axis=0) + layout.places.min(axis=0)) / 2.0
    shifts = {tuple(np.round(shift, 12)) for shift in (centre, layout.places.mean(axis=0))}
    for shift in map(np.array, sorted(shifts)):
        if np.linalg.norm(shift) > SHIFT_MIN * longest:
            words = ' and '.join(
                f'{100.0 * abs(value):.3g} cm {"behind" if i == 0 else "right of"}'
                if value > 0.0 else
                f'{100.0 * abs(value):.3g} cm {"in front of" if i == 0 else "left of"}'
                for i, value in enumerate(shift.tolist()) if abs(value) > 0.01 * longest)
            yield 'centre', 0, f"the centre of mass is {words} the rotors' centre", _Layout(
                layout.places - shift, layout.axes, layout.spins, layout.thrusts)


def _changes(layout: _Layout) -> Iterator[tuple[str, int, str, _Layout]]:
    """Yield kind, rotor from 1 on, words and layout of each change of a rotor."""
    longest = float(np.linalg.norm(layout.places, axis=1).max())
    usual, balance = float(np.median(layout.thrusts)), abs(layout.spins.sum())
    sizes = np.unique(np.round(np.abs(layout.places), 6))
    for i, place in enumerate(layout.places):
        flipped = layout.changed(i, spins=-layout.spins[i])
        if abs(flipped.spins.sum()) < balance:
            yield 'spin', i + 1, f'rotor {i + 1} turns the wrong way: flip its spin', flipped
        ratio = layout.thrusts[i] / usual
        beside = np.linalg.norm(layout.places - place, axis=1) < SAME_PLACE * longest
        weak = COAXIAL_WEAK if beside.sum() > 1 else WEAK
        if not weak < ratio < 1.0 / WEAK:
            text = f'rotor {i + 1} gives {ratio:.2g} times the thrust of the others'
            yield 'thrust', i + 1, text, layout.changed(i, thrusts=usual)
        # In our frame, and in one with y to the right.
        moves = [(sign * place[::-1], 'x and y are exchanged') for sign in (1.0, -1.0)]
        for axis, name in enumerate('xy'):
            old = float(place[axis])
            others = [-old, 10.0 * old, 0.1 * old] if old else [*sizes, *-sizes]
            for new in others:
                moved = place.copy()
                moved[axis] = new
                moves.append((moved, (
                    f'{name} is {old:.4g} m from the centre of mass, where {new:.4g} m would fit '
                    'the other rotors')))
        for moved, words in moves:
            changed = layout.changed(i, places=moved)
            # What is right lies about the centre of mass.
            beside = float(np.linalg.norm(changed.places.mean(axis=0)))
            if np.linalg.norm(moved - place) > SLIP_MIN * longest and beside < SHIFT_MIN * longest:
                yield 'position', i + 1, f'rotor {i + 1}: {words}', changed


def _symmetries(layout: _Layout) -> int:
    """Return how many reflections and rotations map the rotors to each other.

    Rotors that all turn the same way have none: nothing would give them a yaw torque.
    """
    places, longest = layout.places, float(np.linalg.norm(layout.places, axis=1).max())
    if not longest or np.ptp(layout.spins) == 0.0:
        return 0
    angles = np.arctan2(places[:, 1], places[:, 0])
    far = np.linalg.norm(places, axis=1) > 0.1 * longest
    # An axis of reflection halves the angle between a rotor and its image.
    halves = (angles[far][:1, None] + angles[far][None, :]).ravel() / 2.0
    turns = (angles[far][None, :] - angles[far][:1, None]).ravel()
    found = set()
    for reflects, given in ((True, halves), (False, turns)):
        period = np.pi if reflects else 2.0 * np.pi
        for angle in given.tolist():
            whole = angle % period
            if not reflects and min(whole, period - whole) < TURN_MIN:
                continue
            if _maps(layout, whole, reflects, longest):
                found.add((reflects, round(whole / period * 720) % 720))
    return len(found)


def _maps(layout: _Layout, angle: float, reflects: bool, longest: float) -> bool:
    """Return whether a reflection about a line at an angle, or a rotation, maps the rotors."""
    c, s = (np.cos(2.0 * angle), np.sin(2.0 * angle)) if reflects else (
        np.cos(angle), np.sin(angle))
    matrix = np.array([[c, s], [s, -c]]) if reflects else np.array([[c, -s], [s, c]])
    images, spins = layout.places @ matrix.T, -layout.spins if reflects else layout.spins
    axes = np.column_stack([layout.axes[:, :2] @ matrix.T, layout.axes[:, 2]])
    same = np.linalg.norm(images[:, None] - layout.places, axis=2) < SAME_PLACE * longest
    same &= np.linalg.norm(axes[:, None] - layout.axes, axis=2) < SAME_AXIS
    same &= spins[:, None] == layout.spins
    ratio = layout.thrusts[:, None] / layout.thrusts
    same &= np.abs(ratio - 1.0) < SAME_THRUST
    # Places differ by more than the tolerance, so a rotor has one image but on coaxial arms.
    return bool(same.any(axis=0).all() and same.any(axis=1).all())

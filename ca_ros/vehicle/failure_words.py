"""Rotor failures as text: ``ROTOR`` or ``ROTOR=HEALTH``, separated by commas."""

from ca_ros.settings import ParameterError
from ca_ros.vehicle.vehicle import Vehicle

ALL = 'all'  # stands for each rotor


def read_failures(text: str) -> dict[str, float]:
    """Return the health of each rotor that a text such as ``1,3=0.4`` or ``all=0.8`` names.

    The keys are the numbers of the rotors, from 1, or 'all'; without a health it is 0. Raises a
    ParameterError that names the fault.
    """
    failures: dict[str, float] = {}
    for word in text.split(','):
        rotor, equals, share = (part.strip() for part in word.partition('='))
        try:
            number, health = 1 if rotor == ALL else int(rotor), float(share) if equals else 0.0
        except ValueError:
            number = 0
        if number < 1:
            raise ParameterError(
                f'{text!r}: expected ROTOR or ROTOR=HEALTH, such as 1 or 1,3=0.4; rotors are '
                f'numbered from 1, and {ALL} stands for each'
            )
        if not 0.0 <= health <= 1.0:
            raise ParameterError(f'{text!r}: expected a health in [0, 1]')
        name = ALL if rotor == ALL else str(number)
        if name in failures:
            raise ParameterError(f'{text!r}: rotor {name} twice')
        failures[name] = health
    return failures


def with_failures(vehicle: Vehicle, failures: dict[str, float]) -> Vehicle:
    """Return a vehicle after failures by rotor, see `read_failures`.

    Raises a ParameterError if the vehicle has no such rotor.
    """
    if ALL in failures:
        vehicle = vehicle.with_health([failures[ALL]] * vehicle.n)
    for rotor, share in failures.items():
        if rotor != ALL:
            vehicle = vehicle.fail(int(rotor), share)
    return vehicle


def in_words(failures: dict[str, float]) -> str:
    """Return failures in words, such as ``without rotor 1, rotor 3 at 40 %``."""
    return ', '.join(
        f'{_name(rotor)} at {100.0 * health:g} %' if health else f'without {_name(rotor)}'
        for rotor, health in failures.items()
    )


def _name(rotor: str) -> str:
    return 'all rotors' if rotor == ALL else f'rotor {rotor}'

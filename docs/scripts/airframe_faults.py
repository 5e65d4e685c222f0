"""Plant faults in airframe files of PX4; fill the table of docs/doctor.md.

Each file goes through ``ca_ros px4-parameters from-px4`` and ``ca_ros audit``, and through the
rules of actuator-lint (pip install actuator-lint==0.4.2).  Its engine is built from PX4's code and
is not on PyPI: `matrices` computes what it returns by the formulas of PX4 v1.17.0
(ActuatorEffectivenessRotors, ControlAllocationPseudoInverse).
"""

import contextlib
import io
import re
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from actuator_lint.rules import AXES, check
from pages import fill

from ca_ros.__main__ import main
from ca_ros.px4.parameters import DEFAULTS, NAMES
from ca_ros.studies.tables import table

Airframe = dict[str, str]
NUMBERS = ['--mass', '1.5', '--speed-min', '50', '--speed-max', '800',
           '--thrust-coefficient', '1e-5']  # fmt: skip
WEAK = 0.05  # greatest entry of a row that PX4 v1.17.0 sets to zero


def airframe(places: list[tuple[float, float]], senses: str) -> Airframe:
    """Return the parameters of an airframe; + turns counter-clockwise."""
    given = {'CA_AIRFRAME': '0', 'CA_ROTOR_COUNT': str(len(places))}
    for i, ((x, y), sense) in enumerate(zip(places, senses, strict=True)):
        given |= {f'CA_ROTOR{i}_PX': f'{x:.4f}', f'CA_ROTOR{i}_PY': f'{y:.4f}',
                  f'CA_ROTOR{i}_KM': f'{sense}0.05', f'CA_ROTOR{i}_CT': '6.5'}  # fmt: skip
    return given


QUAD = airframe([(0.15, 0.2), (-0.15, -0.2), (0.15, -0.2), (-0.15, 0.2)], '++--')
HEX = airframe([
    (0.0, 0.275), (0.0, -0.275), (0.238, -0.138), (-0.238, 0.138), (0.238, 0.138),
    (-0.238, -0.138)], '-+-++-')  # fmt: skip


def scaled(kind: str, factor: float) -> Callable[[Airframe], Airframe]:
    """Return a fault: all values of a kind are multiplied."""
    return lambda given: {
        name: f'{factor * float(value):g}' if re.fullmatch(rf'CA_ROTOR\d+_{kind}', name) else value
        for name, value in given.items()}  # fmt: skip


def shifted(given: Airframe) -> Airframe:
    """Return the rotors 5 cm further in front."""
    return {name: f'{float(value) + 0.05:g}' if name.endswith('_PX') else value
            for name, value in given.items()}  # fmt: skip


def exchanged(i: int, j: int) -> Callable[[Airframe], Airframe]:
    """Return a fault: two rotors have each other's place."""
    return lambda given: given | {
        f'CA_ROTOR{a}_{kind}': given[f'CA_ROTOR{b}_{kind}']
        for a, b in ((i, j), (j, i)) for kind in ('PX', 'PY')}  # fmt: skip


def misspelt(given: Airframe) -> Airframe:
    """Return the airframe with CA_ROTOR3_PXX."""
    return {name.replace('ROTOR3_PX', 'ROTOR3_PXX'): value for name, value in given.items()}


def same_sense(given: Airframe) -> Airframe:
    """Return the airframe with all KM positive."""
    return {name: value.lstrip('-') if name.endswith('KM') else value
            for name, value in given.items()}  # fmt: skip


FAULTS: dict[str, tuple[Airframe, Callable[[Airframe], Airframe]]] = {
    'a name is misspelt, `CA_ROTOR3_PXX`': (HEX, misspelt),
    'six rotors, `CA_ROTOR_COUNT` 5': (HEX, lambda g: g | {'CA_ROTOR_COUNT': '5'}),
    'millimetres': (QUAD, scaled('P[XY]', 1000.0)),
    'centimetres': (QUAD, scaled('P[XY]', 100.0)),
    'the point at another digit, PX 1.5 for 0.15': (QUAD, lambda g: g | {'CA_ROTOR0_PX': '1.5'}),
    'the sign of one PY': (HEX, lambda g: g | {'CA_ROTOR3_PY': '-0.138'}),
    'PX and PY of a rotor exchanged': (
        HEX, lambda g: g | {'CA_ROTOR2_PX': '-0.138', 'CA_ROTOR2_PY': '0.238'}),
    'a rotor points down, AZ 1': (QUAD, lambda g: g | {'CA_ROTOR2_AZ': '1'}),
    'the sign of one KM': (HEX, lambda g: g | {'CA_ROTOR2_KM': '0.05'}),
    'all KM positive': (QUAD, same_sense),
    'two rotors exchanged, quadrotor': (QUAD, exchanged(0, 2)),
    'two rotors exchanged, hexarotor': (HEX, exchanged(0, 1)),
    'centre of mass 5 cm behind': (QUAD, shifted),
    'one CT half as large': (HEX, lambda g: g | {'CA_ROTOR1_CT': '3.25'}),
    'y of all rotors mirrored': (QUAD, scaled('PY', -1.0)),
}
"""Fifteen faults: what the table says, the sound airframe, and what is done to it."""


def matrices(given: Airframe) -> dict[str, Any]:
    """Return what actuator-lint's engine returns of a multirotor."""
    n = int(given['CA_ROTOR_COUNT'])
    rotors = [{kind: float(given.get(f'CA_ROTOR{i}_{kind}', value))
               for kind, value in DEFAULTS.items()} for i in range(n)]  # fmt: skip
    place, axis = (
        np.array([[rotor[kind + each] for each in 'XYZ'] for rotor in rotors]) for kind in 'PA')
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    ct, km = (np.array([[rotor[kind]] for rotor in rotors]) for kind in ('CT', 'KM'))
    rows = np.hstack([ct * np.cross(place, axis) - ct * km * axis, ct * axis]).T
    weak = [name for name, row in zip(AXES, rows, strict=True)
            if row.any() and np.abs(row).max() <= WEAK]  # fmt: skip
    rows[[AXES.index(name) for name in weak]] = 0.0
    mix = np.linalg.pinv(rows)
    # PX4 scales roll and pitch, yaw and thrust so that columns have entries of about 1.
    size = np.sqrt((mix**2).sum(axis=0) / (n / 2.0))
    sizes = np.array([max(size[:2]), max(size[:2]), np.abs(mix[:, 2]).max(),
                      *[np.abs(mix[:, 3:]).sum(axis=0).max() / n] * 3])  # fmt: skip
    mix /= np.where(sizes > 1e-6, sizes, 1.0)
    known = {*NAMES, 'CA_AIRFRAME'}
    return {
        'px4_version': 'v1.17.0', 'ca_airframe': 0, 'num_motors': n, 'num_servos': 0,
        'unknown_parameters': [name for name in given if name not in known],
        'matrices': [{
            'index': 0, 'weak_axes_zeroed': weak, 'dropped_axes_bitmask': None,
            'actuators': [{'type': 'motor', 'index': i} for i in range(n)],
            'effectiveness': dict(zip(AXES, rows.tolist(), strict=True)),
            'mix': [dict(zip(AXES, row, strict=True)) for row in mix.tolist()]}],
    }  # fmt: skip


def linted(given: Airframe) -> str:
    """Return the findings of actuator-lint."""
    found = check(matrices(given), params=given).findings
    return '; '.join(f'{each.rule} {each.message}' for each in found)


def examined(given: Airframe) -> str:
    """Return what ca_ros says at the import, and then in the audit."""
    with tempfile.TemporaryDirectory() as folder:
        file, made = Path(folder) / 'airframe', Path(folder) / 'made.yaml'
        file.write_text(''.join(
            f'param set-default {name} {value}\n' for name, value in given.items()))
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = main(['px4-parameters', 'from-px4', str(file), *NUMBERS])
        said = err.getvalue()
        if not code:
            made.write_text(out.getvalue())
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(err):
                main(['audit', str(made)])
            said = err.getvalue()
    words = re.sub(rf'{re.escape(str(file))}: |ca_ros [a-z0-9-]+: |warning: ', '', said)
    return re.sub('\n?allocation.lost_axes: .*', '; refused', words).strip()


def short(text: str) -> str:
    """Return the beginning of a text for a cell."""
    text = text.replace('|', '/')
    return text if len(text) <= 160 else f'{text[:157].rsplit(" ", 1)[0]} ...'


def run() -> None:
    """Print both tools' words in full, and fill the table."""
    for name, sound in (('quadrotor', QUAD), ('hexarotor', HEX)):
        assert not examined(sound) + linted(sound), name
    rows = []
    for name, (sound, fault) in FAULTS.items():
        ours, theirs = examined(fault(sound)), linted(fault(sound))
        print(f'{name}\n    ca_ros: {ours or "-"}\n    actuator-lint: {theirs or "-"}')
        rows.append([name, short(ours) or 'nothing', short(theirs) or 'nothing'])
    fill('doctor.md', planted_faults=table(
        ['fault', 'ca_ros', 'actuator-lint 0.4.2'], rows, words=3))


if __name__ == '__main__':
    run()

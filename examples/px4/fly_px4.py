"""Fly PX4 alone, with its own loops and its own allocation, as far as simulation is faster.

    python fly_px4.py --px4 ~/PX4-Autopilot/build/px4_sitl_default --out flights

The hexarotor loses each of its rotors while PX4 holds its position.  That needs a simulator in
which parameters stop motors (SIH_LOST, a bit mask) and tell PX4 of it (SIH_TOLD).
"""

import argparse
import re
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from sitl import Sitl, parsed

HEIGHT = 4.0  # [m]
METHODS = {'pseudo_inverse': 0, 'sequential_desaturation': 1}  # CA_METHOD


def simulated(sitl: Sitl) -> float:
    """Return PX4's time [s]."""
    said = sitl.shell('listener', 'vehicle_local_position', '-n', '1')
    found = re.search(r'timestamp: (\d+)', said)
    return int(found[1]) / 1e6 if found else 0.0


def wait(sitl: Sitl, seconds: float) -> None:
    """Let simulated time pass."""
    end = simulated(sitl) + seconds
    while simulated(sitl) < end:
        time.sleep(0.02)


def fly(method: str, rotor: int, told: bool, to: Path, options: argparse.Namespace) -> None:
    """Fly once."""
    parameters = {
        'CA_METHOD': METHODS[method], 'CA_FAILURE_MODE': int(told), 'MIS_TAKEOFF_ALT': HEIGHT,
    }
    with TemporaryDirectory(prefix='px4_') as folder, Sitl(
        options.px4, 'hex', Path(folder, 'sitl'), options.speed, options.nice, parameters,
        instance=options.instance,
    ) as sitl:
        limit = time.monotonic() + 120.0
        while 'armed: True' not in sitl.shell('listener', 'actuator_armed', '-n', '1'):
            sitl.shell('commander', 'takeoff')
            time.sleep(0.5)
            if time.monotonic() > limit:
                raise TimeoutError(f'PX4 does not take off: {sitl.folder}')
        wait(sitl, 15.0)
        mask = str(1 << rotor - 1)
        sitl.shell('param', 'set', 'SIH_LOST', mask)
        if told:
            # At once: until the next line has run, a tenth of a simulated second passes.
            sitl.shell('param', 'set', 'SIH_TOLD', mask)
        wait(sitl, 12.0)
        sitl.log(to)


def main() -> None:
    """Fly with each method, each rotor, told of its loss or not."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--repeat', type=int, default=1, help='flights of each kind')
    options = parsed(parser, speed=5.0)
    for number in range(1, options.repeat + 1):
        for method in METHODS:
            for rotor in range(1, 7):
                for told in (False, True):
                    label = f'px4-{method.replace("_", "-")}-{"told" if told else "untold"}'
                    name = f'lost-{rotor}_{label}_{number}.ulg'
                    fly(method, rotor, told, options.out / name, options)
                    print(name, flush=True)


if __name__ == '__main__':
    main()

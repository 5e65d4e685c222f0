"""``ca_ros fit-thrust``: a thrust curve from the CSV file of a test stand."""

import argparse
from functools import partial
from pathlib import Path

import numpy as np

from ca_ros.arguments import command, finite
from ca_ros.settings import ParameterError
from ca_ros.vehicle.formats.thrust_stand import StandFit, fit, read_stand
from ca_ros.vehicle.parameter_text import parameter_text


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add, units = parser.add_argument, 'each with its unit in brackets'
    columns = f'columns of thrust, speed, throttle or PWM, torque and voltage, {units}'
    add('file', type=Path, help=f'a CSV file with a title for each column: {columns}')
    add('--out', type=Path, metavar='YAML', help='write a parameter file (default: print it)')
    add('--plot', type=Path, metavar='PNG', help='draw points, curve and errors')
    add('--table', action='store_true', help='the measured points instead of a polynomial')
    add('--speed-max', type=finite, metavar='W', help='if no speed was measured: the greatest one '
        '[rad/s]; speeds are then nominal')  # fmt: skip


def run(options: argparse.Namespace) -> None:
    """Fit, print and write."""
    columns = read_stand(options.file)
    try:
        found = fit(columns, options.speed_max, options.table)
    except ParameterError as error:
        raise ParameterError(f'{options.file}: {error}') from None
    text = parameter_file(found, options.file.name)
    if options.out is not None:
        options.out.write_text(text, encoding='utf-8')
    if options.plot is not None:
        draw(found, options.plot)
    print('\n'.join(summary(found)) if options.out is not None else text)


def summary(found: StandFit) -> list[str]:
    """Return the errors of k_f w^2, of the curve, and of THR_MDL_FAC, and what was assumed."""
    top = found.thrusts.max()

    def line(name: str, rms: float, worst: float) -> str:
        return f'{name:12} error {rms:.3g} N rms, {worst:.3g} N ({worst / top:.1%}) at most'

    lines = [
        f'{len(found.speeds)} points up to {top:.4g} N at {found.speeds[-1]:.4g} rad/s',
        line('k_f w^2', *found.error(found.square)), line('curve', *found.error(found.curve)),
    ]
    if found.throttles is not None:
        worst = found.expo_error(found.expo)
        lines.append(f'THR_MDL_FAC  {found.expo:.2f}: error {worst:.3g} N ({worst / top:.1%})')
    at = '' if found.throttles is None else f' (throttle {found.throttles[0]:.3g})'
    lines.append(f'speed_min    {found.speeds[0]:.4g} rad/s, the slowest row{at}: lower it if the '
                 'motor idles more slowly')
    return [*lines, found.note] if found.note else lines


def parameter_file(found: StandFit, source: str) -> str:
    """Return the text of a parameter file with what was measured."""
    first, *others = summary(found)
    title = '\n'.join([f'From {source}: {first}.', *others])
    return parameter_text({'rotors': found.settings}, title)


def draw(found: StandFit, file: Path) -> None:
    """Draw thrust and errors over speed, and thrust over throttle."""
    import matplotlib.pyplot as plt

    from ca_ros.figures import COLORS, STYLE

    with plt.rc_context(STYLE):
        throttled = found.throttles is not None
        figure, axes = plt.subplots(
            1, 2 + throttled, figsize=(4.0 * (2 + throttled), 3.2), layout='constrained'
        )
        w, f = found.speeds, found.thrusts
        over = np.linspace(0.0, w[-1], 300)
        laws = {'$k_f \\omega^2$': found.square, 'curve': found.curve}
        axes[0].plot(w, f, 'o', color='black', ms=4, label='measured')
        for color, (label, law) in zip(COLORS, laws.items(), strict=False):
            axes[0].plot(over, law.thrust(over), color=color, label=label)
            axes[1].plot(w, 1e3 * (law.thrust(w) - f), 'o-', ms=3, color=color, label=label)
        axes[0].set(xlabel='speed [rad/s]', ylabel='thrust [N]')
        axes[1].set(xlabel='speed [rad/s]', ylabel='error of the thrust [mN]')
        if found.throttles is not None:
            x = np.linspace(0.0, 1.0, 200)
            axes[2].plot(found.throttles, f, 'o', color='black', ms=4, label='measured')
            shares = (found.expo * x + 1.0 - found.expo) * x
            label = f'THR_MDL_FAC {found.expo:.2f}'
            axes[2].plot(x, f[-1] * shares, color=COLORS[2], label=label)
            axes[2].set(xlabel='throttle', ylabel='thrust [N]')
        for each in axes:
            each.legend()
        figure.savefig(file, dpi=150)
        plt.close(figure)


main = partial(command, 'fit-thrust', add_options, run)

"""The command ``attainable``: plots the admissible set of a vehicle or a matrix."""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ca_ros.arguments import HelpFormatter, split
from ca_ros.arrays import Array
from ca_ros.errors import message
from ca_ros.figures import COLORS, INCH, WIDTHS, add_options, save, sheet, style
from ca_ros.problem.admissible_set import AdmissibleSet
from ca_ros.problem.files import read_problem
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.vehicle_problem import VehicleProblem
from ca_ros.settings import ParameterError
from ca_ros.solver.polytope import Polytope
from ca_ros.studies.sets.sections import fixed, labels, units
from ca_ros.vehicle.failure_words import in_words, read_failures, with_failures
from ca_ros.vehicle.vehicle import Vehicle

LOOKS: Any = (('-', 0.25), ((0, (4, 2)), 0.35), ((0, (1, 1)), 0.45))
"""Dashes of the edges and strength of the colour of each set.

Some readers of PDF files do not draw hatches.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Draw the figure; return the exit code."""
    options = _parse(sys.argv[1:] if argv is None else argv)
    try:
        sets = _sets(options)
        problem = next(iter(sets.values())).problem
        names = problem.axes
        if len(names) < 2:
            raise ValueError(f'expected at least two axes, the problem has {names[0]}')
        axes = options.axes or [axis for axis in ('roll', 'pitch') if axis in names] or names[:2]
        at = _at(problem, axes, options)
        figure, found = _plot(sets, axes, at, options.projection, options.figure_width)
        if options.at and all(each.empty for each in found.values()):
            raise ValueError(f'--at: nothing is attainable there for any {" and ".join(axes)}')
        options.out.parent.mkdir(parents=True, exist_ok=True)
        files = save(figure, options.out, options.figures)
    except (ValueError, OSError) as error:
        print(f'attainable: {message(error)}', file=sys.stderr)
        return 1
    for name, polytope in found.items():
        ends = (
            f'{axis} {values.min():+.3g} to {values.max():+.3g} {units(problem)[axis][1]}'.rstrip()
            for axis, values in zip(axes, polytope.vertices.T, strict=True)
        )
        print(f'{name}: {"nothing" if polytope.empty else ", ".join(ends)}')
    print(f'written: {", ".join(map(str, files))}')
    return 0


def plot(
    sets: Mapping[str, AdmissibleSet], axes: Sequence[str], at: Array | None = None,
    projection: bool = False, width: float = WIDTHS['page'],
) -> Figure:
    """Plot admissible sets: a section of two axes is a filled polygon, of three axes a body.

    - `sets`: by their names in the legend; all with the same axes
    - `axes`: the two or three axes to draw; a ValueError if one is unknown or repeated
    - `at` (m,): a wrench with the values of the other axes, the same for all sets; by default the
      reference of the first problem, hover for a vehicle [N, N m]
    - `projection`: draw projections instead: the other axes have any attainable value
    - `width`: width of the figure [mm]
    """
    problem = next(iter(sets.values())).problem
    wrench = problem.reference if at is None else problem.check(at)
    return _plot(sets, axes, wrench, projection, width)[0]


def _plot(
    sets: Mapping[str, AdmissibleSet], axes: Sequence[str], at: Array, projection: bool,
    width: float,
) -> tuple[Figure, dict[str, Polytope]]:
    """Return the figure, whose title says what is fixed, and what it shows."""
    shapes = {
        name: image.projection(axes) if projection else image.section(axes, at)
        for name, image in sets.items()
    }
    problem = next(iter(sets.values())).problem
    words = 'other axes: any value' if projection else fixed(problem, axes, at)
    reference = problem.reference[[problem.axes.index(axis) for axis in axes]]
    point = problem.aim.removeprefix('the ')
    return draw(shapes, reference, labels(problem, axes), words, width, point), shapes


def _parse(argv: Sequence[str]) -> argparse.Namespace:
    made = argparse.ArgumentParser(
        prog='attainable',
        description='Plot the wrenches that the rotors can produce: a section of the admissible '
        'set through hover, or a projection. Two axes make a plane figure, three a body.',
        formatter_class=HelpFormatter,
    )
    add = made.add_argument
    add('--vehicle', default='hexarotor', help='a shipped vehicle or problem, or a YAML file')
    add('--axes', type=_words, metavar='A,B', help='two or three axes')
    add('--at', type=_values, default={}, metavar='AXIS=VALUE,...',
        help='values of the other axes, where they are not those of hover')
    add('--projection', action='store_true', help='let the other axes have any attainable value')
    add('--fail', action='append', metavar='ROTOR[=HEALTH],...',
        help='also draw the set after failures: 3 without rotor 3, 3=0.6 with 60 %% of it')
    add('--out', type=Path, default=Path('attainable'), metavar='PATH', help='without the suffix')
    add_options(made)
    options = made.parse_args(split(argv)[0])
    try:
        options.fail = read_failures(','.join(options.fail)) if options.fail else {}
    except ParameterError as error:
        made.error(f'argument --fail: {error}')
    return options


def _words(text: str) -> list[str]:
    words = [word.strip() for word in text.split(',')]
    if len(words) not in (2, 3):
        raise argparse.ArgumentTypeError(f'{text!r}: expected two or three axes')
    return words


def _values(text: str) -> dict[str, float]:
    pairs = [word.partition('=') for word in text.split(',')]
    try:
        return {name.strip(): float(value) for name, _, value in pairs}
    except ValueError:
        raise argparse.ArgumentTypeError(f'{text!r}: expected AXIS=NUMBER') from None


def _sets(options: argparse.Namespace) -> dict[str, AdmissibleSet]:
    """Return the sets to draw, by their names in the legend."""
    read = read_problem(options.vehicle, AllocationProblem)
    if read is not None:
        if options.fail:
            raise ParameterError('--fail: the effectors of a problem have no health')
        return {options.vehicle: AdmissibleSet(read[0])}
    vehicle = Vehicle.load(options.vehicle)
    found = {'all rotors' if options.fail else options.vehicle: vehicle}
    if options.fail:
        found[in_words(options.fail)] = with_failures(vehicle, options.fail)
    return {name: AdmissibleSet(VehicleProblem(each)) for name, each in found.items()}


def _at(problem: AllocationProblem, axes: Sequence[str], options: argparse.Namespace) -> Array:
    """Return the wrench (m,) through which the section is."""
    at = problem.reference.copy()
    if options.at and options.projection:
        raise ValueError('--at: in a projection the other axes have any attainable value')
    for axis, value in options.at.items():
        if axis not in problem.axes:
            raise ValueError(f'--at: no axis {axis!r}; there are {", ".join(problem.axes)}')
        if axis in axes:
            raise ValueError(f'--at: {axis} is drawn, and has no single value')
        at[problem.axes.index(axis)] = value
    return at


def draw(
    polytopes: Mapping[str, Polytope], reference: Array, labels: Sequence[str], words: str = '',
    width: float = WIDTHS['page'], point: str = 'reference',
) -> Figure:
    """Plot polytopes of two axes as filled polygons, or of three axes as bodies.

    They stand by their names in the legend; a + marks the reference (k,), a `point` of this name.
    The labels are those of the axes, the words the title; the figure has a width [mm].
    """
    with matplotlib.rc_context(style(width)):
        looks = [_style(i) for i in range(len(polytopes))]
        handles = [
            Patch(label=f'{name}: nothing' if each.empty else name, **look)
            for (name, each), look in zip(polytopes.items(), looks, strict=True)
        ]
        height = 0.8 * min(width, 110.0) / INCH
        mark: Any = {'color': 'black', 'marker': '+', 'linestyle': 'none', 'markersize': 9,
                     'markeredgewidth': 1.6, 'zorder': 9}
        cross = Line2D([], [], label=point, **mark)
        figure, body = sheet(height, [*handles, cross] if len(handles) > 1 else [cross])
        solid = len(labels) == 3
        plot: Any = body.add_subplot(projection='3d' if solid else None)
        for polytope, look in zip(polytopes.values(), looks, strict=True):
            if solid and not polytope.empty:
                _draw_body(plot, polytope, look)
            elif not polytope.empty:
                # Colours do not blend, and every edge is above every fill.
                plot.fill(*polytope.vertices.T, color=_pale(look['facecolor']), linewidth=0.0)
                edge = {**look, 'facecolor': 'none', 'zorder': 4}
                plot.fill(*polytope.vertices.T, **edge)
        plot.plot(*reference[:, None], **mark)
        plot.set(title=words, xlabel=labels[0], ylabel=labels[1])
        if solid:
            plot.set_zlabel(labels[2])
            for axis in (plot.xaxis, plot.yaxis, plot.zaxis):
                axis.labelpad = 7.0
            plot.set_box_aspect(None, zoom=0.8)
            plot.locator_params(nbins=4)
            plot.auto_scale_xyz(*np.vstack([each.vertices for each in polytopes.values()]).T)
        elif len({label.partition('[')[2] for label in labels} - {''}) == 1:
            # Axes of one unit have one scale.
            plot.set_aspect('equal')
    return figure


def _style(i: int) -> dict[str, Any]:
    """Return the style of set i: sets differ in grey too."""
    dashes, opacity = LOOKS[i % len(LOOKS)]
    color = COLORS[i % len(COLORS)]
    face = matplotlib.colors.to_rgba(color, opacity)
    return {'facecolor': face, 'edgecolor': color, 'linestyle': dashes, 'linewidth': 1.4}


def _pale(color: tuple[float, ...]) -> tuple[float, ...]:
    """Return an opaque colour like a transparent one on white."""
    *parts, opacity = color
    return tuple(1.0 - opacity * (1.0 - part) for part in parts)


def _draw_body(plot: Any, polytope: Polytope, look: dict[str, Any]) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

    faces = [polytope.vertices[corners] for corners in polytope.corners()]
    plot.add_collection3d(Poly3DCollection(faces, **{**look, 'linewidth': 0.8}))

"""Figures in print: one column wide, readable, and without fonts of Type 3."""

from itertools import combinations
from re import search

import pytest

pytest.importorskip('matplotlib')
pytest.importorskip('pandas')

import matplotlib
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.figure import Figure

from ca_ros.bringup.report import draw_flight
from ca_ros.control.trajectory import Trajectory
from ca_ros.control.waypoint import Waypoint
from ca_ros.figures import HIGHEST, millimetres, save, style
from ca_ros.simulation.closed_loop import fly
from ca_ros.studies.cases import Case
from ca_ros.studies.dynamic import study as dynamic_study
from ca_ros.studies.dynamic.plots import ROWS
from ca_ros.studies.plot_style import PANELS_MAX, panel_titles
from ca_ros.studies.sets import attainable
from ca_ros.studies.static import study as static_study
from strategies import length

pytestmark = pytest.mark.slow

FONT_MIN = 7.0
"""Smallest font [pt]."""

COLUMN = millimetres('column')
PRINT = ['--figures', 'pdf', '--figure-width', 'column']


def static(out):
    axes = '[force_x, force_y, thrust, roll, pitch, yaw]'
    assert static_study.main([
        '--vehicle', 'hexarotor_tilted', '-p', f'allocation.axes:={axes}', '--samples', '30',
        '--methods', 'exact,pseudo_inverse,redistributed_pseudo_inverse,conventional', *PRINT,
        '--out', str(out)]) == 0


def dynamic(out):
    methods = 'exact,redistributed_pseudo_inverse,fixed_pseudo_inverse,weighted_least_squares'
    assert dynamic_study.main([
        '--fail', '1@4', '--duration', '5', '--methods', methods, *PRINT, '--out', str(out),
        '--plot-rows', ','.join(ROWS)]) == 0
    assert (out / 'rows.pdf').is_file()


def section(out):
    assert attainable.main(['--fail', '1', *PRINT, '--out', str(out / 'section')]) == 0


def body(out):
    assert attainable.main([
        '--axes', 'roll,pitch,yaw', '--fail', '1=0.6', *PRINT, '--out', str(out / 'body')]) == 0


def bringup(out):
    case, goal = Case.load('x8'), Waypoint.of(1.0, 1.0, 1.0, 0.8)
    flight = fly(case.controller(), case.allocator('exact'), case.body(), goal, 1.0)
    save(draw_flight(flight, case.vehicle, Trajectory.to(goal), COLUMN), out / 'flight', ['pdf'])


COMMANDS = length([bringup], [static, dynamic, section, body, bringup])


def texts(figure, monkeypatch):
    """Return the texts that are drawn, each with its extent."""
    drawn, plain = {}, RendererAgg.draw_text

    def draw_text(self, gc, x, y, s, prop, angle, ismath=False, mtext=None):
        if s.strip() and mtext is not None:
            drawn[id(mtext)] = mtext
        plain(self, gc, x, y, s, prop, angle, ismath, mtext)

    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # The layout is found here.
    with monkeypatch.context() as patch:
        patch.setattr(RendererAgg, 'draw_text', draw_text)
        canvas.draw()
    return [(text, text.get_window_extent(canvas.get_renderer())) for text in drawn.values()]


def apart(one, other):
    """Whether extents overlap by less than a pixel, a hundredth of an inch."""
    return (min(one.x1, other.x1) - max(one.x0, other.x0) < 1.0
            or min(one.y1, other.y1) - max(one.y0, other.y0) < 1.0)


@pytest.mark.parametrize('command', COMMANDS, ids=lambda command: command.__name__)
def test_a_figure_of_one_column_is_readable_and_has_no_type_3_font(
        command, tmp_path, monkeypatch):
    figures, savefig = {}, Figure.savefig

    def kept(figure, file, **options):
        figures[file] = figure
        savefig(figure, file, **options)

    monkeypatch.setattr(Figure, 'savefig', kept)
    command(tmp_path)
    assert set(figures) == set(tmp_path.glob('*.pdf')) != set()
    for file, figure in figures.items():
        content = file.read_bytes()
        assert b'/Type3' not in content, file.name
        assert b'/FontFile2' in content, file.name
        sizes = search(rb'/MediaBox \[ ?0 0 ([\d.]+) ([\d.]+)', content).groups()
        width, height = (float(size) / 72.0 * 25.4 for size in sizes)
        assert width == pytest.approx(COLUMN, abs=0.1)
        assert height <= HIGHEST + 0.1
        found = texts(figure, monkeypatch)
        assert len(found) > 10
        page = figure.bbox.padded(1.0)
        for text, extent in found:
            words = f'{file.name}: {text.get_text()!r}'
            assert text.get_fontsize() >= FONT_MIN, words
            assert page.x0 <= extent.x0 < extent.x1 <= page.x1, f'{words} is clipped'
            assert page.y0 <= extent.y0 < extent.y1 <= page.y1, f'{words} is clipped'
        # The labels of a body are oblique, and their extents are not.
        straight = [each for each in found if each[0].get_rotation() % 90.0 == 0.0]
        for (text, extent), (other, its) in combinations(straight, 2):
            assert apart(extent, its), f'{file.name}: {text.get_text()!r}, {other.get_text()!r}'


def test_six_panels_have_titles_or_letters_and_the_note_names_the_rest():
    with matplotlib.rc_context(style(COLUMN)):
        assert panel_titles([['exact'], ['direct']], 1.0) == (['exact', 'direct'], [])
        many = [[f'm{i}'] for i in range(7)]
        groups = [['exact', 'conventional', 'weighted_least_squares'], *many]
        titles, notes = panel_titles(groups, 1.0)
    assert titles == list('abcdef')
    assert len(titles) == PANELS_MAX
    assert notes[0] == 'a: exact, conventional, weighted least squares'
    assert notes[1:] == ['b: m0', 'c: m1', 'd: m2', 'e: m3', 'f: m4', 'not drawn: m5, m6']

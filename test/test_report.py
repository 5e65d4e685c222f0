"""The report: its numbers are those of the studies, and a browser shows it without a complaint."""

import json
import os
import re
import shutil
import subprocess
from base64 import b64decode
from html import escape
from html.parser import HTMLParser

import pytest
from matplotlib import image

from ca_ros.evaluation import dynamic_study, static_study
from ca_ros.evaluation.benchmark import benchmark
from ca_ros.evaluation.report.markdown import html
from ca_ros.evaluation.report.report import main

pytestmark = pytest.mark.slow

CHROMIUM = shutil.which('chromium') or shutil.which('chromium-browser') or shutil.which(
    'google-chrome')
VOID = {'meta', 'link', 'img', 'br', 'hr'}


class Page(HTMLParser):
    """A page that was read: every element closed in its turn, its attributes and its text."""

    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.open, self.attributes, self.cells, self.words = [], [], [], []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.attributes += [(tag, name, value or '') for name, value in attrs]
        if tag not in VOID:
            self.open.append(tag)
        if tag == 'td':
            self.cells.append('')

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)
        if 'td' in self.open:
            self.cells[-1] += data

    def all(self, name):
        """Return the values of an attribute wherever it is."""
        return [value for _, key, value in self.attributes if key == name]


@pytest.fixture(scope='module')
def folders(tmp_path_factory):
    """Return the folders of small studies, and of a benchmark's files."""
    folder = tmp_path_factory.mktemp('results')
    static = ['--samples', '30', '--seed', '7', '--figures', 'svg', '-p', 'vehicle.mass:=1.1']
    assert static_study.main([*static, '--out', str(folder / 'static')]) == 0
    assert dynamic_study.main(['--duration', '6', '--out', str(folder / 'dynamic')]) == 0
    least = ['--quick', '--no-nodes', '--samples', '3', '--methods', 'exact', '--figures', 'svg']
    assert benchmark.main([*least, '--out', str(folder / 'benchmark')]) == 0
    with (folder / 'benchmark' / 'benchmark.md').open('a', encoding='utf-8') as file:
        file.write('\nSee [the source](https://example.org) of <b>it</b>.\n')
    return folder


@pytest.fixture(scope='module')
def text(folders):
    """Return the text of the report of all three."""
    out = folders / 'all.html'
    assert main([
        *(word for name in ('static', 'dynamic', 'benchmark')
          for word in (f'--{name}', str(folders / name))), '--out', str(out)]) == 0
    return out.read_text(encoding='utf-8')


def test_it_has_the_numbers_of_the_studies(text, folders):
    page = Page(text)
    static = json.loads((folders / 'static' / 'static.json').read_text(encoding='utf-8'))
    for name, found in static['methods'].items():
        row = page.cells.index(name)
        for i, key in enumerate(('force_error', 'torque_error', 'time')):
            assert page.cells[row + 2 + i] == f'{found[key]["mean"]:.1e} / {found[key]["max"]:.1e}'
    dynamic = json.loads((folders / 'dynamic' / 'dynamic.json').read_text(encoding='utf-8'))
    said = ''.join(page.words)
    for name, found in dynamic['methods'].items():
        errors = found['steady_state_error']
        assert ', '.join(f'{1e3 * errors[axis]:.2f}' for axis in 'xyz') in page.cells, name
    for sentence in dynamic['observations']:
        assert sentence in said
    speed = json.loads((folders / 'benchmark' / 'benchmark.json').read_text(encoding='utf-8'))
    for promise in speed['promises']:
        assert promise['what'].replace('`', '') in page.cells
    [ratio] = [
        each['ratio'] for each in speed['results']
        if (each['part'], each['load'], each['contender']) == ('calls', 'flight', 'exact')]
    assert f'{ratio:.3g}x' in page.words
    assert re.search(
        r'static_study .*--param vehicle\.mass:=1\.1 --samples 30 --seed 7 --sampling volume',
        said)
    for key, value in static['versions'].items():
        assert page.cells[page.cells.index(f'versions: {key}') + 1] == value
    assert page.cells[page.cells.index('rotors.speed_max') + 1] == '400.0'


def test_it_needs_nothing_from_elsewhere(text):
    page = Page(text)
    assert [value for value in page.all('src') if not value.startswith('data:image/')] == []
    assert [value for value in page.all('href') if not value.startswith(('#', 'data:,'))] == []
    assert not {tag for tag, *_ in page.attributes} & {'script', 'iframe', 'object', 'form'}
    assert [name for _, name, _ in page.attributes if name.startswith('on')] == []
    assert 'http://' not in text
    assert 'https://' not in text
    assert 'url(' not in text


def test_all_plots_are_in_it(text, folders):
    pictures = [value.partition(',') for value in Page(text).all('src')]
    written = [
        b64decode(data) for _, _, data in pictures]
    for name, suffix, stems in (
        ('static', 'svg', ('slices', 'violations', 'errors', 'latency')),
        ('dynamic', 'png', ('position', 'attitude', 'rotor_speeds')),
        ('benchmark', 'svg', ('benchmark',))):
        for stem in stems:
            assert (folders / name / f'{stem}.{suffix}').read_bytes() in written, stem
    assert all(Page(text).all('alt'))


def test_every_link_leads_somewhere_and_every_cell_knows_its_column(text):
    page = Page(text)
    anchors = page.all('id')
    assert len(set(anchors)) == len(anchors)
    targets = {value[1:] for value in page.all('href') if value.startswith('#')}
    assert targets <= set(anchors)
    assert {'static', 'dynamic', 'benchmark', 'static-made'} <= targets
    assert 'force error [N], mean / max' in page.all('data-label')


def test_the_same_results_give_the_same_page(text, folders, tmp_path):
    again = tmp_path / 'again.html'
    assert main([
        '--static', str(folders / 'static'), '--dynamic', str(folders / 'dynamic'),
        '--benchmark', str(folders / 'benchmark'), '--out', str(again)]) == 0
    assert again.read_text(encoding='utf-8') == text


def test_what_is_absent_is_said(folders, tmp_path, capsys):
    assert main([
        '--dynamic', str(folders / 'dynamic'), '--out', str(tmp_path / 'new' / 'one.html')]) == 0
    assert 'without --static, --benchmark' in capsys.readouterr().out
    said = ''.join(Page((tmp_path / 'new' / 'one.html').read_text(encoding='utf-8')).words)
    assert said.count('Not in this report') == 2
    assert 'report --static DIR' in said


@pytest.mark.parametrize('written', [
    '<script>alert(1)</script>', '<img src=x onerror=alert(1)>', '[l](javascript:alert(1))',
    '![i](https://example.org/x.png)', '`<b>`', '| a |\n|---|\n| <i>x</i> |', '# <b>t</b>',
    '## <b>t</b>', '&lt;b&gt; &#60;b&#62;', '> <b>', '- Holds: <b>', '```\n<b>\n```',
])
def test_nothing_of_the_text_becomes_html(written):
    start, rest, _ = html(written, 'x')
    page = Page(start + rest)
    allowed = {'class', 'id', 'data-label'}
    assert {name for _, name, _ in page.attributes} <= allowed
    tags = set(re.findall(r'<(\w+)', start + rest))
    assert not tags & {'script', 'img', 'a', 'b', 'i'}


def test_another_vehicle_is_not_judged_by_the_paper(tmp_path):
    static, dynamic, speed = (str(tmp_path / name) for name in ('static', 'dynamic', 'benchmark'))
    x8 = ('--vehicle', 'x8', '--methods', 'exact,direct')
    assert static_study.main([*x8, '--samples', '10', '--out', static]) == 0
    assert dynamic_study.main([*x8, '--duration', '2', '--out', dynamic]) == 0
    assert benchmark.main([*x8, '--quick', '--no-nodes', '--samples', '3', '--out', speed]) == 0
    out = tmp_path / 'x8.html'
    assert main(['--static', static, '--dynamic', dynamic, '--benchmark', speed,
                 '--out', str(out)]) == 0
    said = ''.join(Page(out.read_text(encoding='utf-8')).words)
    said = said[said.index('Tables, plots and how'):]
    for word in ('paper', 'hexarotor', 'promise', 'missed by the', 'holds: ', 'not hold'):
        assert word not in said.lower(), word


# Faults

def fault(capsys, *arguments):
    """Run to a bad end; return the one line that it says."""
    assert main(arguments) == 1
    out, err = capsys.readouterr()
    assert out == ''
    [line] = err.splitlines()
    assert line.startswith('report: ')
    return line


def test_a_folder_that_is_no_studys_is_refused_in_one_line(folders, tmp_path, capsys):
    out = ('--out', str(tmp_path / 'x.html'))
    assert 'static_study' in fault(capsys, '--static', str(tmp_path), *out)
    shutil.copytree(folders / 'static', tmp_path / 'static')
    file = tmp_path / 'static' / 'static.json'
    for wrong in (b'{', b'[]', b'7', b'[' * 100_000, b'{"methods": {}}', b'\xff\xfe'):
        file.write_bytes(wrong)
        line = fault(capsys, '--static', str(tmp_path / 'static'), *out)
        assert 'static.json: not written by this version of static_study' in line
    assert not (tmp_path / 'x.html').exists()


def test_nothing_to_report_is_an_error(capsys):
    with pytest.raises(SystemExit) as stop:
        main([])
    assert stop.value.code == 2
    assert '--benchmark DIR' in capsys.readouterr().err.splitlines()[-1]


# In a browser

def browse(folder, page, *options):
    """Open a page in Chromium; return what it writes and what is on its console."""
    sandbox = ['--no-sandbox'] if os.geteuid() == 0 else []
    process = subprocess.run(
        [CHROMIUM, '--headless', '--disable-gpu', '--hide-scrollbars', '--enable-logging=stderr',
         f'--user-data-dir={folder / "profile"}', *sandbox, *options, page.as_uri()],
        capture_output=True, text=True)
    assert process.returncode == 0, process.stderr
    return process.stdout, [line for line in process.stderr.splitlines() if 'CONSOLE' in line]


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason='there is no Chromium here')
@pytest.mark.parametrize('width', [1400, 1280, 390])
def test_a_browser_shows_it_without_a_complaint(text, tmp_path, width):
    page, picture = tmp_path / 'page.html', tmp_path / 'page.png'
    page.write_text(text, encoding='utf-8')
    _, console = browse(tmp_path, page, f'--window-size={width},2000', f'--screenshot={picture}')
    assert console == []
    shown = image.imread(picture)
    assert shown.shape[1] == width
    assert shown[..., :3].std() > 0.05
    # Nothing is wider than the window, and no table wider than its place; in a frame, as windows
    # have a least width of their own.
    page.write_text(
        f'<iframe width="{width}" height="2000" style="border: 0" srcdoc="{escape(text)}" onload="'
        'const page = this.contentDocument;'
        "const wide = [...page.querySelectorAll('.scroll')]"
        '.filter(each => each.scrollWidth > each.clientWidth);'
        'document.title = page.documentElement.scrollWidth'
        " + ', cut off: ' + wide.map(each => each.innerText.slice(0, 40)).join('; ')\"></iframe>",
        encoding='utf-8')
    dom, console = browse(tmp_path, page, '--window-size=1500,2100', '--dump-dom')
    assert console == []
    assert f'<title>{width}, cut off: </title>' in dom


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason='there is no Chromium here')
def test_the_browser_would_complain_of_what_is_forbidden(text, tmp_path):
    # Otherwise the test above would prove nothing.
    page = tmp_path / 'page.html'
    page.write_text(text.replace('</body>', '<script>1</script></body>'), encoding='utf-8')
    assert browse(tmp_path, page, '--dump-dom')[1] != []

"""Compare the answers of two versions: ``python -m release.compare BASE HEAD``.

Installs each version from its commit into an environment of its own, where `answers` runs with the
kernel in C, and compares bit for bit.  Exit code 1 if answers differ.
"""

import json
import os
import subprocess
import sys
import venv
from collections import defaultdict
from io import BytesIO
from pathlib import Path
from tarfile import TarFile
from typing import Any

import numpy as np

FOLDER = Path('out/compare')


def numpy() -> str:
    """Return the requirement of numpy that asv has, so both use one version."""
    settings = json.loads(Path('asv.conf.json').read_text(encoding='utf-8'))
    return f'numpy=={settings["matrix"]["req"]["numpy"][0]}'


def git(*words: str) -> bytes:
    """Return the output of git."""
    return subprocess.run(['git', *words], check=True, stdout=subprocess.PIPE).stdout


def answers_of(revision: str) -> dict[str, Any]:
    """Return the answers of a revision; they are computed once."""
    commit = git('rev-parse', '--short=10', f'{revision}^{{commit}}').decode().strip()
    place = (FOLDER / commit).resolve()
    # The libraries of a ROS from PyPI are no business of these environments.
    environ = {
        name: value for name, value in os.environ.items()
        if name not in ('LD_LIBRARY_PATH', '_ROS_WHEELS_BOOTSTRAP_COMPLETE', 'PYTHONPATH')
    }
    python, file = place / 'bin' / 'python', place / 'answers.npz'
    if not (place / 'installed').exists():
        print(f'installing {revision} ({commit}) into {place.relative_to(Path.cwd())}', flush=True)
        venv.create(place, with_pip=True, clear=True)
        with TarFile(fileobj=BytesIO(git('archive', commit))) as archive:
            archive.extractall(place / 'source')
        install = [str(python), '-m', 'pip', 'install', '-q', '--disable-pip-version-check']
        subprocess.run([*install, numpy(), str(place / 'source')], check=True, env=environ)
        (place / 'installed').touch()
    here = Path(__file__).resolve().parent.parent
    command = [str(python), '-m', 'release.answers', str(file)]
    subprocess.run(command, check=True, env=environ, cwd=here)
    with np.load(file) as found:
        return dict(found)


def difference(one: Any, other: Any) -> str:
    """Return how two arrays differ, '' if they are equal to the last bit."""
    if one.shape != other.shape:
        return f'shape {one.shape}, then {other.shape}'
    if one.dtype.kind != 'f':
        where = np.argwhere(one != other)
        if not len(where):
            return ''
        first = tuple(where[0])
        return f'{len(where)} of {one.size}, first {one[first]!s:.60} -> {other[first]!s:.60}'
    differs = (one != other) & ~(np.isnan(one) & np.isnan(other))
    # A zero's sign is a bit, too.
    differs |= np.signbit(one) != np.signbit(other)
    if not differs.any():
        return ''
    worst = float(np.max(np.abs(one[differs] - other[differs])))
    return f'{np.count_nonzero(differs)} of {one.size}, at most {worst:.2g}'


def main(argv: list[str]) -> int:
    """Print what differs, vehicle by vehicle; return 1 if anything does."""
    base, head = argv or ('HEAD~1', 'HEAD')
    before, after = answers_of(base), answers_of(head)
    lines: dict[str, list[str]] = defaultdict(list)
    alone: dict[tuple[str, str], list[str]] = defaultdict(list)
    equal: dict[str, int] = defaultdict(int)
    for name in dict.fromkeys([*before, *after]):
        subject, part = name.split('|', 1)
        if name not in before or name not in after:
            value = (before if name in before else after)[name]
            text = f'{part}: {value[0]}' if part == 'cannot' else part
            alone[subject, base if name in before else head].append(text)
        elif found := difference(before[name], after[name]):
            lines[subject].append(f'{part}: {found}')
        else:
            equal[subject] += before[name].size
    for (subject, side), parts in alone.items():
        lines[subject].append(f'{len(parts)} only in {side}, such as {parts[0]}')
    for subject in dict.fromkeys(name.split('|', 1)[0] for name in (*before, *after)):
        print(f'{subject}: {equal[subject]} values equal, {len(lines[subject])} parts differ')
        for line in lines[subject]:
            print(f'    {line}')
    return int(any(lines.values()))


if __name__ == '__main__':
    raise SystemExit(main(sys.argv[1:]))

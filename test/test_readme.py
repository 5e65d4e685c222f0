"""The generated parts of README, the parameters and the architecture say what the code does."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.parametrize('script', ['readme.py', 'architecture.py'])
def test_the_generated_parts_are_up_to_date(script):
    command = [sys.executable, str(ROOT / 'docs' / script), '--check']
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


def test_readme_is_short():
    assert len((ROOT / 'README.md').read_text(encoding='utf-8').splitlines()) <= 150

"""README and the table of parameters say what the code does."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def test_the_generated_parts_are_up_to_date():
    command = [sys.executable, str(ROOT / 'docs' / 'readme.py'), '--check']
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr

"""Run the design study of docs/studies.md, and fill the tables of the page; takes seconds."""

from pathlib import Path
from tempfile import TemporaryDirectory

from pages import fill

from ca_ros.evaluation.design_study import main

if __name__ == '__main__':
    with TemporaryDirectory() as folder:
        if code := main(['--random', '1000', '--best', '3', '--out', folder]):
            raise SystemExit(code)
        study = (Path(folder) / 'design.md').read_text(encoding='utf-8')
    tables = study[study.index('## ') : study.index('Two numbers')]
    fill('studies.md', designs=tables.replace('## ', '### ').strip())

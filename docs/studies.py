"""Run the design study of docs/studies.md, and fill the tables of the page; takes seconds."""

from pathlib import Path
from tempfile import TemporaryDirectory

from marks import filled

from ca_ros.evaluation.design_study import main

PAGE = Path(__file__).resolve().parent / 'studies.md'

if __name__ == '__main__':
    with TemporaryDirectory() as folder:
        if code := main(['--random', '1000', '--best', '3', '--out', folder]):
            raise SystemExit(code)
        study = (Path(folder) / 'design.md').read_text(encoding='utf-8')
    tables = study[study.index('## ') : study.index('Two numbers')]
    text = PAGE.read_text(encoding='utf-8')
    content = tables.replace('## ', '### ').strip()
    PAGE.write_text(filled(text, 'designs', content), encoding='utf-8')

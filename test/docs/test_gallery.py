"""The notebooks of the gallery run, and are as small as a page needs."""

from pathlib import Path

import pytest

nbformat = pytest.importorskip('nbformat', reason='nbformat is not installed')
nbclient = pytest.importorskip('nbclient', reason='nbclient is not installed')
pytest.importorskip('ipykernel', reason='ipykernel is not installed')
GALLERY = Path(__file__).resolve().parents[2] / 'docs' / 'gallery'
NOTEBOOKS = sorted(GALLERY.glob('*.ipynb'))


def test_the_gallery_has_its_five_notebooks():
    names = {'simulate', 'fit', 'diagnose', 'own_effect', 'own_structure'}
    assert {file.stem for file in NOTEBOOKS} == names
    index = (GALLERY / 'index.md').read_text()
    assert all(name in index for name in names)


@pytest.mark.parametrize('file', NOTEBOOKS, ids=lambda file: file.stem)
def test_a_notebook_runs_and_shows_what_it_printed(file):
    kept = nbformat.read(file, 4)
    assert file.stat().st_size < 1_000_000
    assert all(cell.outputs for cell in kept.cells if cell.cell_type == 'code' and 'print' in cell.source)
    nbclient.NotebookClient(kept, timeout=300, kernel_name='python3').execute()  # raises for a cell that fails

"""Settings of the documentation: `sphinx-build -W --keep-going docs docs/_build`."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

project, author = 'sma_sim', 'The sma_sim developers'
project_copyright = author
extensions = ['myst_nb', 'sphinx.ext.autodoc', 'sphinx.ext.napoleon', 'sphinx.ext.mathjax', 'sphinx.ext.viewcode']
html_theme, html_title = 'furo', 'sma_sim'
exclude_patterns = ['_build']
nb_execution_mode = 'off'  # the notebooks keep what they showed; test/docs/test_gallery.py runs them
myst_enable_extensions = ['dollarmath', 'amsmath']
myst_heading_anchors = 4
napoleon_numpy_docstring, napoleon_google_docstring = True, False
autodoc_typehints = 'signature'
autodoc_member_order = 'bysource'
python_use_unqualified_type_names = True

"""Fetch plotly.js for the HTML reports: `python .ci/update_plotly.py VERSION` (the version of the installed plotly fits).

The cartesian bundle has every kind of figure that the reports draw at a third of the size of the full library, which is
what Python's plotly package carries. It comes from the npm registry, checked against the registry's SHA-512, and is stored
compressed beside its licence.
"""

import base64
import gzip
import hashlib
import io
import json
import sys
import tarfile
import urllib.request
from pathlib import Path

PACKAGE = 'plotly.js-cartesian-dist-min'
TEMPLATES = Path(__file__).resolve().parents[1] / 'sma_sim' / 'report' / 'templates'
FILES = {'package/plotly-cartesian.min.js': 'plotly-cartesian.min.js.gz', 'package/LICENSE': 'plotly-LICENSE.txt'}


def package(version: str) -> bytes:
    """The package as the registry has it; raises ValueError where it is not what its checksum says."""
    with urllib.request.urlopen(f'https://registry.npmjs.org/{PACKAGE}/{version}') as answer:
        origin = json.load(answer)['dist']
    with urllib.request.urlopen(origin['tarball']) as answer:
        content: bytes = answer.read()
    checksum = 'sha512-' + base64.b64encode(hashlib.sha512(content).digest()).decode()
    if checksum != origin['integrity']:
        raise ValueError(f'{origin["tarball"]}: checksum {checksum}, expected {origin["integrity"]}')
    return content


def main(version: str) -> None:
    """Write the bundle and its licence; the same version gives the same bytes."""
    with tarfile.open(fileobj=io.BytesIO(package(version))) as archive:
        for inside, name in FILES.items():
            file = archive.extractfile(inside)
            assert file is not None, inside
            content = file.read()
            (TEMPLATES / name).write_bytes(gzip.compress(content, 9, mtime=0) if name.endswith('.gz') else content)


if __name__ == '__main__':
    main(sys.argv[1])

"""Draw the rooms of the package and their imports, and write the table of docs/explanation/architecture.md.

python docs/make_architecture.py

A room is a folder of sma_sim (of sma_sim/evidence, where these are rooms). Its floor is the longest chain of imports below
it. The picture shows an arrow only where no chain of other arrows leads to the same room; the table has all imports.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE, PAGE = ROOT / 'sma_sim', ROOT / 'docs' / 'explanation' / 'architecture.md'
PICTURE = ROOT / 'docs' / 'figures' / 'architecture.png'
BEGIN, END = '<!-- made by docs/make_architecture.py -->\n', '<!-- end -->\n'
QUESTIONS = {
    'cli': 'How is it called? One file per command',
    'cli/common': 'What do the commands share?',
    'ros': 'How does it talk to ROS 2?',
    'explore': 'How is a model explored? Sessions with a history, and their page',
    'gym': 'How does an agent learn to control it? Gymnasium environments',
    'workflow': 'Which steps do commands and page share? From a request to results and files',
    'words': 'How are results said? Sentences for people, JSON for programs',
    'report': 'How are results shown? Figures and HTML pages',
    'challenge': 'Would the diagnosis find what is hidden?',
    'evidence/diagnosis': 'Which effect is missing?',
    'evidence/experiment_design': 'Which experiment decides?',
    'evidence/symbolic_regression': 'Which equation describes the missing part?',
    'evidence/latent_input': 'Which force, heat or strain over time is missing?',
    'evidence/set_up': 'Is something wrong with the recordings, before physics is searched for?',
    'evidence/search': 'Which sets of components explain the recordings, and how probable are they?',
    'evidence/model_selection': 'What could a candidate explain, and where do fits with it begin?',
    'evidence/residual_analysis': 'Where is the error?',
    'evidence/monitoring': 'Does a running robot still follow the model?',
    'evidence/control': 'Which command makes a running robot follow a target?',
    'evidence/state_estimation': 'How hot are the wires of a running robot? Observer and guard',
    'evidence/estimation': 'Which parameters fit, and how certain are they?',
    'evidence/data': 'What was measured? Files, units, noise',
    'solver': 'How do the equations evolve? Steps, events, samples, tangents',
    'compiler': 'How does Python become native code, and where is it kept?',
    'model': 'What are the equations? Material, structures, effects',
}
COLOURS = {
    'cli': '#cfe0f5',
    'ros': '#cfe0f5',
    'report': '#cfe0f5',
    'words': '#cfe0f5',
    'workflow': '#cfe0f5',
    'gym': '#cfe0f5',
    'explore': '#cfe0f5',
    'evidence': '#d9efd9',
    'challenge': '#f3e3c3',
}
COLUMNS = {  # where the boxes stand, so that no arrow crosses one
    'challenge': -3.4,
    'cli/common': -2.4,
    'evidence/latent_input': -1.4,
    'evidence/experiment_design': 1.7,
    'ros': 3.4,
    'explore': 1.0,
    'workflow': 1.0,
    'evidence/diagnosis': 2.4,
    'evidence/symbolic_regression': 1.3,
    'evidence/residual_analysis': 2.3,
    'evidence/monitoring': 3.0,
    'evidence/state_estimation': 3.6,
    'gym': 2.4,
}


def room_of(parts: tuple[str, ...]) -> str:
    """The room of a file or module, from its path below the package."""
    two_deep = parts[0] == 'evidence' or parts[:2] == ('cli', 'common')
    return '/'.join(parts[:2]) if two_deep else parts[0]


def imported(file: Path) -> Iterator[str]:
    """Names of the package's modules that a file imports, without the package's name."""
    for node in ast.walk(ast.parse(file.read_text())):
        names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module]
        yield from (name.removeprefix('sma_sim.') for name in names if name.startswith('sma_sim.'))


def imports() -> dict[str, list[str]]:
    """The rooms that each room imports."""
    found: dict[str, set[str]] = {}
    for file in PACKAGE.rglob('*.py'):
        parts = file.relative_to(PACKAGE).parts
        if len(parts) > 1 and parts != ('evidence', '__init__.py'):
            room = room_of(parts)
            found.setdefault(room, set()).update(room_of(tuple(name.split('.'))) for name in imported(file))
    return {room: sorted(others - {room}) for room, others in sorted(found.items())}


def floors(graph: dict[str, list[str]]) -> dict[str, int]:
    """The longest chain of imports below each room. Raises RecursionError where imports form a circle."""

    def height(room: str) -> int:
        return max((1 + height(other) for other in graph[room]), default=0)

    return {room: height(room) for room in graph}


def direct(graph: dict[str, list[str]]) -> list[tuple[str, str]]:
    """The imports that no chain of other imports replaces."""

    def below(room: str) -> set[str]:
        return set(graph[room]).union(*map(below, graph[room]))

    return [(a, b) for a in graph for b in graph[a] if not any(b in below(c) for c in graph[a])]


def table(graph: dict[str, list[str]]) -> str:
    """Rooms from the top floor down, with their question and their imports."""
    floor = floors(graph)
    rows = [
        f'| `{room}/` | {QUESTIONS[room]} | {", ".join(f"`{other}`" for other in graph[room]) or "-"} |'
        for room in sorted(graph, key=lambda room: (-floor[room], room))
    ]
    return '\n'.join(['| room | question | imports |', '|---|---|---|', *rows, ''])


def draw() -> None:
    """Rooms as boxes on floors, imports as arrows."""
    import matplotlib

    matplotlib.use('Agg')
    import matplotlib.pyplot as plt

    graph = imports()
    at = {room: (COLUMNS.get(room, 0.0), height) for room, height in floors(graph).items()}
    figure, axis = plt.subplots(figsize=(10.0, 9.0))
    for a, b in direct(graph):
        start, end = (at[a][0], at[a][1] - 0.2), (at[b][0], at[b][1] + 0.3)
        axis.annotate('', end, start, arrowprops={'arrowstyle': '->', 'color': '0.45', 'shrinkA': 0, 'shrinkB': 0})
    for room, (x, y) in at.items():
        box = {'boxstyle': 'round,pad=0.45', 'fc': COLOURS.get(room.split('/')[0], '#eeeeee'), 'ec': '0.4'}
        axis.text(x, y, room.replace('evidence/', 'evidence/\n'), ha='center', va='center', bbox=box, size=10)
    axis.set(xlim=(-4.0, 4.0), ylim=(-0.5, max(y for _, y in at.values()) + 0.5))
    axis.axis('off')
    figure.tight_layout()
    figure.savefig(PICTURE, dpi=90)


def page_with_table() -> str:
    """The page, with the table as it should be."""
    text = PAGE.read_text()
    head, rest = text.split(BEGIN)
    return head + BEGIN + table(imports()) + END + rest.split(END)[1]


if __name__ == '__main__':
    PAGE.write_text(page_with_table())
    draw()

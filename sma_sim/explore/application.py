"""What the page can ask for: each verb takes plain JSON and answers with JSON or a packed message."""

from __future__ import annotations

import json
import math
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from threading import Lock
from typing import Any

from sma_sim.evidence.data.tables import write_whole
from sma_sim.explore.command import Command, columns_of, command_from, first_command
from sma_sim.explore.controls import LEFT_OUT, OF_MAS, controls_of
from sma_sim.explore.data_verbs import DataVerbs
from sma_sim.explore.differences import Value
from sma_sim.explore.live import LiveVerbs
from sma_sim.explore.overlay import display_of
from sma_sim.explore.packing import Numbers
from sma_sim.explore.request_values import Body, Reply, as_int, json_number, pixels_in, text, window_in
from sma_sim.explore.runs import ShownRun, curves_data, frames_data, run_of
from sma_sim.explore.session import Session
from sma_sim.explore.stages import Engine
from sma_sim.model.config import MODELS, Config, flat_parameters
from sma_sim.model.effects.discovery import find_effects
from sma_sim.model.errors import UserError
from sma_sim.model.given import effect_folders_of
from sma_sim.model.parameter_file import parameter_file
from sma_sim.report.palette import MODE_COLOURS, MODE_NAMES

COMMAND_FILE = 'command.json'
RUNS_KEPT = 6


class Application:
    """One session behind the page; verbs may be called from several threads.

    `announce` is called with a kind and data whenever something changes that other tabs should know.
    """

    def __init__(self, session: Session, effect_folders: Sequence[Path], announce: Callable[[str, Body], None]) -> None:
        self.session, self._announce = session, announce
        self.data = DataVerbs(session, Engine(session), self.config_in, self.changed)
        self.live = LiveVerbs(session)
        self._known = find_effects(effect_folders)
        self._command = self.stored_command()
        self._runs: OrderedDict[str, ShownRun] = OrderedDict()
        self._running, self._counting = Lock(), Lock()
        self._changes = 0
        self.verbs: Mapping[str, Callable[[Body], Reply]] = {
            'state': self.state,
            'curves': self.curves,
            'frames': self.frames,
            'change': self.change,
            'undo': self.undo,
            'redo': self.redo,
            'go_to': self.go_to,
            'rename': self.rename,
            'differences': self.differences,
            'command': self.set_command,
            **self.data.verbs,
            **self.live.verbs,
        }

    def stored_command(self) -> Command:
        """The command that the session was left with; of another structure, or where there is none, a first one."""
        config = self.session.config()
        try:
            text = (self.session.folder / COMMAND_FILE).read_text(encoding='utf-8')
            return command_from(json.loads(text), config.structure)
        except (OSError, ValueError, RecursionError, UserError):
            return first_command(config)

    def first_run(self) -> None:
        """Simulate what a page asks for first; what goes wrong is said when it does."""
        with suppress(UserError):
            self.run(self.session.config())

    def close(self) -> None:
        """End what listens to a robot. A step that runs goes on: the next start of the session finds it."""
        self.live.close()

    def state(self, _: Body) -> Reply:
        """All that the page shows beside curves."""
        changes = self._changes  # read first: what follows is at least as new
        config = self.session.config()
        structure = config.structure
        return {
            'changes': changes,
            'steps': self.data.state(),
            'history': self.session.as_data(),
            'controls': controls_of(config, self._known),
            'command': self._command.as_data(),
            'columns': list(columns_of(structure)),
            'channels': {name: display_of(name) for name in structure.channels},
            'recorded_columns': [*structure.input_columns[:-1], *structure.channel_columns],
            'modes': {number: {'name': MODE_NAMES[number], 'colour': MODE_COLOURS[number]} for number in MODE_NAMES},
        }

    def curves(self, body: Body) -> Reply:
        """Curves of the current version with `values` and `effects` changed, or of `version`, and beside it `beside`."""
        numbers, window, pixels = Numbers(), window_in(body), pixels_in(body)
        return numbers.message(self.with_beside(body, lambda run: curves_data(run, window, pixels, numbers)))

    def frames(self, body: Body) -> Reply:
        """The structure as it moves."""
        numbers = Numbers()
        return numbers.message(self.with_beside(body, lambda run: frames_data(run, numbers)))

    def with_beside(self, body: Body, data_of: Callable[[ShownRun], Any]) -> dict[str, Any]:
        """The data of the run that a request is about, and of that of the version `beside` it, where one is named."""
        shown, beside = data_of(self.run(self.config_in(body))), body.get('beside')
        other = None if beside is None else data_of(self.run(self.session.config(as_int(beside, 'beside'))))
        return {'shown': shown, 'beside': other}

    def change(self, body: Body) -> Reply:
        """A new version."""
        values, effects = self.values_in(body), self.effects_in(body)
        expected = body.get('expected')
        self.session.change(values, effects, expected=None if expected is None else as_int(expected, 'expected'))
        return self.changed()

    def undo(self, _: Body) -> Reply:
        """The version before."""
        self.session.undo()
        return self.changed()

    def redo(self, _: Body) -> Reply:
        """The version that undo left."""
        self.session.redo()
        return self.changed()

    def go_to(self, body: Body) -> Reply:
        """Any version."""
        self.session.go_to(as_int(body.get('number'), 'number'))
        return self.changed()

    def rename(self, body: Body) -> Reply:
        """A name for a version."""
        self.session.rename(as_int(body.get('number'), 'number'), text(body.get('name'), 'name'))
        return self.changed()

    def differences(self, body: Body) -> Reply:
        """In what two versions differ."""
        found = self.session.differences(as_int(body.get('before'), 'before'), as_int(body.get('after'), 'after'))
        return {
            'differences': [
                {name: json_number(getattr(one, name)) for name in ('name', 'unit', 'before', 'after', 'meaning')}
                for one in found
            ]
        }

    def set_command(self, body: Body) -> Reply:
        """Another command."""
        command = command_from(body.get('command'), self.session.config().structure)
        self.run(self.session.config(), command)
        self._command = command
        text = json.dumps(command.as_data())
        write_whole(self.session.folder / COMMAND_FILE, lambda file: file.write(text))
        return self.changed()

    def changed(self) -> Reply:
        """The state, after all tabs were told, and the model beside a robot is that of the current version."""
        self.live.follow()
        with self._counting:
            self._changes += 1
            self._announce('changed', {'changes': self._changes})
        return self.state({})

    def download(self, name: str, words: Mapping[str, str]) -> tuple[str, bytes, str]:
        """A file: its type, bytes and name. Of a ``version``, a ``job`` or an ``export``. Raises UserError."""
        if 'version' not in words:
            return self.data.download(name, words)
        given = words['version']
        if not (given.isascii() and given.isdigit()) or len(given) > 9:
            raise UserError(f'version: expected a number, got {given!r}')
        return (*self.version_file(name, int(given)), name)

    def version_file(self, name: str, number: int) -> tuple[str, bytes]:
        """What a version is saved as: its type and bytes. Raises UserError for an unknown name."""
        config = self.session.config(number)
        if name == 'parameters.yaml':
            folders = [str(folder.resolve()) for folder in effect_folders_of(self.session.file(number), ())]
            text = parameter_file(config, folders)  # absolute: it may be kept anywhere
            return 'application/yaml', text.encode()
        if name == 'run.csv':
            columns = self.run(config).columns
            lines = [','.join(columns), *(','.join(map(csv_cell, row)) for row in zip(*columns.values(), strict=True))]
            return 'text/csv; charset=utf-8', ('\n'.join(lines) + '\n').encode()
        raise UserError(f'no download {name!r}: expected parameters.yaml or run.csv')

    def config_in(self, body: Body) -> Config:
        """The configuration that a request is about."""
        version = body.get('version')
        if version is not None:
            return self.session.config(as_int(version, 'version'))
        values, effects = self.values_in(body), self.effects_in(body)
        return self.session.preview(values, effects) if values or effects is not None else self.session.config()

    def values_in(self, body: Body) -> dict[str, Value]:
        """Values by full name: of parameters that the page shows, and the model. Raises UserError for any others.

        Folders of Python files are never among them: naming one would run what lies there.
        """
        values = body.get('values', {})
        if not isinstance(values, dict):
            raise UserError('values: expected a mapping of names to numbers')
        return {name: self.checked_value(name, value) for name, value in values.items()}

    def checked_value(self, name: str, value: Any) -> Value:
        """One value. Raises UserError."""
        group, _, rest = name.partition('.')
        if name == 'model' and value in MODELS:
            return str(value)
        declared = name in self.session.config().structure.all_parameters or name in OF_MAS
        if group == 'effects':
            declared = rest.partition('.')[0].partition('@')[0] in self._known and bool(rest.partition('.')[2])
        if not declared or group in LEFT_OUT:
            raise UserError(f'{name}: not a parameter of the model that can be changed here')
        if value is None:
            return math.nan
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise UserError(f'{name} = {value!r}: expected a number')
        return float(value)

    def effects_in(self, body: Body) -> list[str] | None:
        """Names of the active effects, None where they stay. Raises UserError."""
        effects = body.get('effects')
        if effects is None:
            return None
        if not isinstance(effects, list) or not all(isinstance(name, str) for name in effects):
            raise UserError('effects: expected a list of names')
        unknown = [name for name in effects if name.partition('@')[0] not in self._known]
        if unknown:
            raise UserError(f'unknown effect {unknown[0]!r}')
        return effects

    def run(self, config: Config, command: Command | None = None) -> ShownRun:
        """The run of a configuration, kept for the next request. Raises UserError."""
        command = command or self._command
        key = repr((sorted(flat_parameters(config).items(), key=lambda item: item[0]), command))
        with self._running:
            if key not in self._runs:
                self._runs[key] = run_of(config, command)
                while len(self._runs) > RUNS_KEPT:
                    self._runs.popitem(last=False)
            self._runs.move_to_end(key)
            return self._runs[key]


def csv_cell(value: float) -> str:
    """A number of a CSV file; a gap is empty."""
    return '' if math.isnan(value) else repr(float(value))

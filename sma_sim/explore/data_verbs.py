"""What the page can ask for of recordings: the steps, what came out of them, curves beside the model, files to take away."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from sma_sim.evidence.data.tables import write_whole
from sma_sim.explore.columns import choices, map_text
from sma_sim.explore.export import PARAMETERS as EXPORTED_PARAMETERS
from sma_sim.explore.export import export
from sma_sim.explore.jobs import FILES, new_folder
from sma_sim.explore.overlay import Overlay, View, overlay_data
from sma_sim.explore.packing import Numbers
from sma_sim.explore.request_values import Body, Reply, as_int, number, pixels_in, text, window_in
from sma_sim.explore.session import Session
from sma_sim.explore.session_files import RECORDINGS
from sma_sim.explore.stages import Engine
from sma_sim.explore.uploads import Uploads
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError
from sma_sim.words.json_values import finite
from sma_sim.words.probabilities import finding_rows, model_rows, probability_lines
from sma_sim.workflow.data_request import DataRequest

MAP = 'map.yaml'  # columns that were chosen on the page
BAG = 'robot'  # what the name of such a bag begins with
CURVE_KINDS = ('measured', 'model', 'residual')
MAX_HELD_OUT = 200
SHOWN_RESULTS = {  # entries of a result that the page shows, by stage
    'compare': ('comparisons', 'noise_std'),
    'check': ('runs', 'noise_std', 'notes', 'system'),
    'calibrate': ('model', 'parameters', 'delay', 'error', 'limits', 'implausible', 'converged', 'interrupted', 'seconds'),
    'diagnose': (
        'verdict',
        'model',
        'effects',
        'ranking',
        'error',
        'intervals',
        'held_out',
        'interrupted',
        'seconds',
        'proposed',
        'next',
    ),
    'candidates': ('errors', 'error', 'expected_error', 'effects'),
}
SHOWN_COMPARISON = ('error', 'channels', 'runs', 'patterns', 'findings', 'spread', 'delay')
TYPES = {'.yaml': 'application/yaml', '.html': 'text/html; charset=utf-8', '.json': 'application/json'}


class DataVerbs:
    """The steps of a session behind the page; verbs may be called from several threads.

    `config_in` finds the configuration that a request is about; `changed` tells all tabs and answers with the state.
    """

    def __init__(
        self, session: Session, engine: Engine, config_in: Callable[[Body], Config], changed: Callable[[], Reply]
    ) -> None:
        self.engine = engine
        self._session, self._config_in, self._changed = session, config_in, changed
        self._overlay, self._uploads = Overlay(engine), Uploads(session.folder)
        self.verbs: Mapping[str, Callable[[Body], Reply]] = {
            'start': self.start,
            'stop': self.stop,
            'job': self.job,
            'overlay': self.overlay,
            'settle': self.settle,
            'part': self.part,
            'accept': self.accept,
            'export': self.export,
            'recordings': self.recordings,
            'upload': self._uploads.take,
            'columns': self.columns,
            'choose_columns': self.choose_columns,
        }

    def state(self) -> dict[str, Any]:
        """The steps and their jobs, for the page."""
        running = self.engine.running()
        version = self._session.current.number
        candidates = self.engine.latest('candidates')
        data, request = self.engine.data(), self._session.data
        compares = (job for job in self.engine.jobs if job.stage == 'compare' and job.data == data)
        compared = {job.version for job in compares if 'curves' in job.files}
        return {
            'data': request.as_data() if request else None,
            'stages': self.engine.overview(),
            'running': running.as_data() if running else None,
            'version': version,
            'candidates': candidates.as_data() if candidates else None,
            'compared': sorted(compared),
            'recorded': [str(path) for path in recorded_bags(self._session.folder)],
        }

    def start(self, body: Body) -> Reply:
        """Begin a step."""
        options = body.get('options', {})
        if not isinstance(options, dict):
            raise UserError('options: expected a mapping')
        self.engine.start(text(body.get('stage'), 'stage'), **options)
        return self._changed()

    def stop(self, _: Body) -> Reply:
        """Ask the step that runs to end with what it has."""
        self.engine.close()
        return self._changed()

    def job(self, body: Body) -> Reply:
        """How a step proceeds: its state, events from number `since` on, and with `result` what came out of it."""
        job = self.engine.job(as_int(body.get('number'), 'number'))
        events = job.events(max(as_int(body.get('since', 0), 'since'), 0))
        answer: dict[str, Any] = {'job': job.as_data(), 'events': events}
        if body.get('result') and 'result' in job.files:
            content = job.result()
            shown = {name: content.get(name) for name in SHOWN_RESULTS[job.stage]}
            if job.stage == 'compare':
                shown['comparisons'] = [{name: one.get(name) for name in SHOWN_COMPARISON} for one in content['comparisons']]
            if job.stage == 'diagnose':
                shown['probability'] = probability_data(content)
            answer['result'] = shown
            answer['summary'] = job.files['summary'].read_text(encoding='utf-8') if 'summary' in job.files else ''
        return finite_reply(answer)

    def overlay(self, body: Body) -> Reply:
        """All recordings beside the model that a request is about."""
        config, numbers = self._config_in(body), Numbers()
        view = View(window_in(body), pixels_in(body), curves_in(body))
        content = overlay_data(self._overlay.beside(config), view, numbers)
        if (beside := body.get('beside')) is not None:
            other = self._session.config(as_int(beside, 'beside'))
            shown = overlay_data(self._overlay.beside(other), replace(view, curves=('model',)), numbers)
            for run, same in zip(content['runs'], shown['runs'], strict=True):
                run['beside'] = same['channels']
        return numbers.message(finite_reply(content))

    def settle(self, body: Body) -> Reply:
        """Estimate delay and starts of the recordings for the model that a request is about; then ask for `overlay`."""
        self._overlay.settle(self._config_in(body))
        return {}

    def part(self, body: Body) -> Reply:
        """What is known of a part of a residual."""
        where = text(body.get('run'), 'run'), text(body.get('channel'), 'channel')
        return finite_reply(
            self.engine.part_of_residual(where, (number(body.get('t0'), 't0'), number(body.get('t1'), 't1')))
        )

    def accept(self, body: Body) -> Reply:
        """The model of a calibration or diagnosis as the current version."""
        given = body.get('number')
        self.engine.accept(None if given is None else as_int(given, 'number'))
        return self._changed()

    def export(self, _: Body) -> Reply:
        """Write the current version with its report and the way to it."""
        done = export(self.engine)
        return {
            'folder': str(done.folder),
            'number': self._session.current.number,
            'shell': done.shell,
            'python': done.python,
            'files': [path.name for path in done.files],
            'yaml': (done.folder / EXPORTED_PARAMETERS).read_text('utf-8'),
        }

    def recordings(self, body: Body) -> Reply:
        """Other recordings, or others held out (`hold_out`: names).

        `batch`: files that were sent (`Uploads`). `recorded`: the bags of the session.
        """
        if self.engine.running() is not None:
            raise UserError('recordings: a step is running on those that are there: wait for it, or stop it')
        request = self._session.data
        if (batch := body.get('batch')) is not None:
            request = self._uploads.request(as_int(batch, 'batch'))
        if body.get('recorded') is True:
            request = DataRequest(tuple(recorded_bags(self._session.folder)))
        if request is None or not request.data:
            raise UserError('recordings: expected files')
        held_out = body.get('hold_out', [])
        if not isinstance(held_out, list) or len(held_out) > MAX_HELD_OUT:
            raise UserError('hold_out: expected a list of names')
        names = tuple(text(name, 'hold_out') for name in held_out)
        if names:
            dataset = replace(request, hold_out=()).read(self._session.config())
            unknown = [name for name in names if name not in [one.name for one in dataset.recordings]]
            if unknown:
                raise UserError(f'hold_out: there is no recording {unknown[0]!r}')
            replace(request, hold_out=names).split(dataset)  # some are to be left to fit
        self._session.set_data(replace(request, hold_out=names))
        return self._changed()

    def columns(self, _: Body) -> Reply:
        """The columns of the files, and which of them are taken for which of ours."""
        return choices(self._chosen_data(), self._session.config().structure.name)

    def choose_columns(self, body: Body) -> Reply:
        """Other columns: written as a column map of the session."""
        request, system = self._chosen_data(), self._session.config().structure.name
        content = map_text(body.get('columns'), request, system)
        _, folder = new_folder(self._session.folder / RECORDINGS)
        write_whole(folder / MAP, lambda file: file.write(content))
        self._session.set_data(replace(request, map=folder / MAP))
        return self._changed()

    def _chosen_data(self) -> DataRequest:
        """The recordings of the session, of which nothing is running. Raises UserError."""
        if self.engine.running() is not None:
            raise UserError('columns: a step is running on the recordings: wait for it, or stop it')
        if self._session.data is None:
            raise UserError('columns: this session has no recordings')
        return self._session.data

    def download(self, name: str, words: Mapping[str, str]) -> tuple[str, bytes, str]:
        """A file of a step (``job``) or of an export (``export``): type, bytes, and a name for it. Raises UserError."""
        kind, given = next(((kind, words[kind]) for kind in ('job', 'export') if kind in words), ('', ''))
        if not (given.isascii() and given.isdigit()) or len(given) > 9:
            raise UserError(f'no download {name!r}: expected the number of a step or of an export')
        number_of = int(given)
        if kind == 'job':
            path = self.engine.job(number_of).files.get(next((k for k, file in FILES.items() if file == name), ''))
        else:
            folder = self._session.folder / 'export' / f'{number_of:04}'
            path = next((one for one in folder.glob('*') if one.name == name and one.is_file()), None)
        if path is None:
            raise UserError(f'there is no {name} of {kind} {number_of}')
        stem, dot, suffix = name.rpartition('.')
        return TYPES.get(f'.{suffix}', 'text/plain; charset=utf-8'), path.read_bytes(), f'{stem}_{given}{dot}{suffix}'


def probability_data(content: Mapping[str, Any]) -> dict[str, Any]:
    """What a diagnosis says of probabilities, in words; empty lists where it says nothing."""
    rows = {'models': model_rows(content), 'findings': finding_rows(content)}
    return {'lines': probability_lines(content), **{name: list(map(asdict, found)) for name, found in rows.items()}}


def curves_in(body: Body) -> tuple[str, ...]:
    """Which curves are asked for. Raises UserError."""
    curves = body.get('curves', ['measured', 'model'])
    if not isinstance(curves, list) or not set(curves) <= set(CURVE_KINDS):
        raise UserError(f'curves: expected some of {", ".join(CURVE_KINDS)}')
    return tuple(curves)


def recorded_bags(session: Path) -> list[Path]:
    """The bags that the page has recorded of a robot, the oldest first."""
    return sorted(path.parent for path in (session / RECORDINGS).glob(f'*/{BAG}*/metadata.yaml'))


def finite_reply(content: dict[str, Any]) -> dict[str, Any]:
    """The same as JSON can hold it."""
    found: dict[str, Any] = finite(content)
    return found

"""The cause of a deviation beside a robot that runs: looked for in a thread of its own, published, and said in the log."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Trigger

from sma_sim.evidence.monitoring.live_model import ComparedSample
from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config
from sma_sim.ros.messages import stamp_of
from sma_sim.ros.qos import LAST_FEW, make_publisher
from sma_sim.words.json_values import finite

if TYPE_CHECKING:  # a check runs without the packages that a diagnosis needs
    from sma_sim.evidence.monitoring.live_diagnosis import LiveDiagnosis, LiveFinding

SERVICE, PERIOD = '~/propose_command', 'check.diagnosis_period'


class CauseWatch:
    """Looks every `period` seconds for what has changed; `tell` hears every finding, from that thread."""

    def __init__(
        self, node: Node, config: Config, noise: Vector, period: float, tell: Callable[[LiveFinding], None] | None
    ) -> None:
        self._node, self._noise, self._period, self._tell = node, noise, period, tell
        self._logger, self._said, self._stop = node.get_logger(), '', threading.Event()
        self.last: LiveFinding | None = None
        self.use(config)
        if self._period > 0.0:
            self._status = make_publisher(node, DiagnosticArray, 'diagnosis', LAST_FEW)
            self._json = make_publisher(node, String, 'diagnosis/json', LAST_FEW)
            node.create_service(Trigger, SERVICE, self._propose)
            threading.Thread(target=self._watch, name='cause of a deviation', daemon=True).start()

    def use(self, config: Config) -> None:
        """Beside another model from now on; nothing is known of its past."""
        self._config, self.last = config, None
        self._diagnosis: LiveDiagnosis | None = None
        if self._period > 0.0:
            try:
                from sma_sim.evidence.monitoring.causes import causes_for
                from sma_sim.evidence.monitoring.live_diagnosis import LiveDiagnosis
            except ImportError as error:
                self._logger.warning(f'no causes of deviations are looked for: {error}; install it, or set {PERIOD} to 0')
                self._period = 0.0
            else:
                self._diagnosis = LiveDiagnosis(config, causes_for(config), self._noise)

    def start(self, begin: int, first: Sequence[float]) -> None:
        """The model starts from rest at `begin` [ns] under its `first` input."""
        self.last = None
        if self._diagnosis is not None:
            self._diagnosis.start(begin, first)

    def add(self, sample: ComparedSample, predicted: Vector, judged: bool) -> None:
        """A measurement beside its prediction (channels,)."""
        if self._diagnosis is not None:
            self._diagnosis.add(sample, predicted, judged)

    def reason(self) -> str:
        """Why the model differs from the measurement, as far as is known, in words; empty where no cause is looked for."""
        found = self.last
        if self._diagnosis is None:
            return ''
        if found is None:
            return 'its cause is being looked for (topic diagnosis)'
        if found.has_changed:
            return str(found)
        if found.is_explained:
            return (
                f'nothing has changed: other values of its parameters explain it (normalized RMSE {found.error:.2f} with '
                'them); calibrate the file'
            )
        first = found.findings[0]
        return f'no cause is certain yet; the most probable: {first.words} ({100.0 * first.probability:.0f} %)'

    def close(self) -> None:
        """Look no more."""
        self._stop.set()

    def _watch(self) -> None:
        while not self._stop.wait(self._period):
            diagnosis = self._diagnosis
            found = None if diagnosis is None else diagnosis.evaluate(self._stop.is_set)
            if found is not None and diagnosis is self._diagnosis and not self._stop.is_set():
                self.last = found
                self._publish(found)
                if self._tell is not None:
                    self._tell(found)

    def _publish(self, found: LiveFinding) -> None:
        data, words = json.dumps(finite(found.as_data())), str(found)
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN if found.is_of_robot else DiagnosticStatus.OK,
            name=self._node.get_fully_qualified_name(),
            message=words,
            hardware_id='cause of a deviation',
            values=[KeyValue(key=one.name, value=f'{one.probability:.4g}') for one in found.findings],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = stamp_of(found.stamp)
        self._status.publish(array)
        self._json.publish(String(data=data))
        name = found.findings[0].name if found.has_changed else ''
        if name and name != self._said:
            (self._logger.warning if found.is_of_robot else self._logger.info)(words)
        elif self._said and not name:
            self._logger.info('the cause of a deviation is gone')
        self._said = name

    def _propose(self, _: Any, response: Any) -> Any:
        """What tells the leading causes apart; it is said, not sent."""
        most = self._config.parameters['node.J_max']
        structure = self._config.structure
        powers = [sign * most for _ in range(max(1, structure.wires // 2)) for sign in (1.0, -1.0)]
        if not structure.antagonistic:
            powers = [most] * structure.wires
        found = None if self._diagnosis is None else self._diagnosis.deciding_command(powers)
        response.success = found is not None
        response.message = (
            'nothing to tell apart: fewer than two causes' if found is None else json.dumps(finite(found.as_data()))
        )
        return response

"""The command in force: nothing that arrives is lost, at whatever moment the simulating thread looks."""

import math
import threading
import time
from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed')
from sma_sim.model.structures.structure import Drive  # noqa: E402
from sma_sim.ros.command import Command, SetPoint  # noqa: E402

J_MAX, TIMEOUT = 40.0, 0.5
ALTERNATIONS = 2_000
PATIENCE = 20.0  # [s] that a command may take to be seen, on a machine with much else to do


class Logger:
    """Calls `hook` where a warning is logged: between what `at` decides and what it does."""

    def __init__(self):
        self.warnings, self.hook = [], lambda: None

    def warning(self, words, **_):
        self.warnings.append(words)
        self.hook()


def command_with(logger, timeout=TIMEOUT):
    return Command(SimpleNamespace(get_logger=lambda: logger), J_MAX, timeout)


def send(command, value):
    command.receive(SimpleNamespace(data=value))


def test_a_command_holds_until_its_timeout():
    logger = Logger()
    command = command_with(logger)
    assert command.at(0.0) == (0.0,)
    send(command, 5.0)
    send(command, 7.0)
    assert [command.at(t) for t in (1.0, 1.4, 1.5)] == [(7.0,)] * 3 and not logger.warnings
    assert command.at(1.6) == command.at(9.0) == (0.0,) and len(logger.warnings) == 1
    send(command, 3.0)
    command.clear()
    assert command.at(10.0) == (0.0,)


@pytest.mark.parametrize('value', [5.0, -60.0])
def test_a_command_that_arrives_while_the_heating_is_turned_off_is_kept(value):
    logger = Logger()
    command = command_with(logger)
    send(command, 9.0)
    assert command.at(0.0) == (9.0,)
    logger.hook = lambda: (setattr(logger, 'hook', lambda: None), send(command, value))
    assert command.at(1.0) == (0.0,)
    assert command.at(1.001) == command.at(1.4) == (max(value, -J_MAX),)


def test_no_command_is_lost_between_two_threads():
    """Each command must come into force, while every look without a new one turns the heating off."""
    logger = Logger()
    logger.hook = lambda: time.sleep(0.0)  # lets the other thread in where the heating is turned off
    command = command_with(logger, timeout=1e-9)
    seen, stop, lost = [0.0], threading.Event(), []

    def follow():
        t = 0.0
        while not stop.is_set():
            t += 1.0
            (value,) = command.at(t)
            if value:
                seen[0] = value

    follower = threading.Thread(target=follow)
    follower.start()
    try:
        for number in range(ALTERNATIONS):
            value = 1.0 + number % 30
            send(command, value)
            end = time.monotonic() + PATIENCE
            while seen[0] != value and time.monotonic() < end:
                time.sleep(0.0)
            if seen[0] != value:
                lost.append(number)
                break
    finally:
        stop.set()
        follower.join()
    assert not lost


def heating(*J, sizes=(), offset=0):
    layout = SimpleNamespace(dim=[SimpleNamespace(size=size) for size in sizes], data_offset=offset)
    return SimpleNamespace(data=list(J), layout=layout)


def test_every_wire_has_a_command_of_its_own():
    logger = Logger()
    command = Command(SimpleNamespace(get_logger=lambda: logger), J_MAX, TIMEOUT, 3, False, 'J')
    assert command.at(0.0) == (0.0, 0.0, 0.0)
    command.receive(heating(1.0, 0.0, 99.0, sizes=(3,)))
    assert command.at(0.1) == (1.0, 0.0, J_MAX) and command.clipped == 1
    command.J_max = 0.5
    assert command.at(0.2) == (0.5, 0.0, 0.5)
    assert command.at(9.0) == (0.0, 0.0, 0.0) and command.timeouts == 1 and command.rejected == 0


@pytest.mark.parametrize(
    ('message', 'reason'),
    [
        (heating(), 'J =  W refused: expected 2 numbers [W], one for each wire, got 0'),
        (heating(1.0), 'J = 1 W refused: expected 2 numbers [W], one for each wire, got 1'),
        (heating(1.0, 2.0, 3.0), 'J = 1, 2, 3 W refused: expected 2 numbers [W], one for each wire, got 3'),
        (heating(1.0, math.nan), 'J = 1, nan W refused: expected finite numbers'),
        (heating(math.inf, 1.0), 'J = inf, 1 W refused: expected finite numbers'),
        (heating(1.0, -1e-9), 'J = 1, -1e-09 W refused: expected no negative number: a wire is heated or it is not'),
        (heating(1.0, 2.0, sizes=(3,)), 'got a layout of the sizes [3] and the offset 0'),
        (heating(1.0, 2.0, offset=1), 'got a layout of the sizes [] and the offset 1'),
    ],
)
def test_heating_that_cannot_be_meant_is_refused_as_a_whole(message, reason):
    logger = Logger()
    command = Command(SimpleNamespace(get_logger=lambda: logger), J_MAX, TIMEOUT, 2, False, 'J')
    command.receive(heating(3.0, 4.0))
    command.receive(message)
    assert command.at(0.0) == (3.0, 4.0) and command.rejected == 1 and not command.clipped
    assert reason in command.refusal and logger.warnings == [f'{command.refusal}; the last good command stays in force']


def test_a_set_point_holds_and_one_out_of_range_is_refused():
    logger = Logger()
    point = SetPoint(SimpleNamespace(get_logger=lambda: logger), Drive('strain', '-', bounds=(-0.5, 0.5)), 298.0)
    send(point, 0.03)
    assert [point.take() for _ in range(3)] == [0.0, 0.03, 0.03]  # the first step is that of the start, for a replay
    for value in (0.6, -math.inf, math.nan):
        send(point, value)
    assert point.take() == 0.03 and point.rejected == len(logger.warnings) == 3
    assert logger.warnings[0] == 'strain = 0.6 refused: expected -0.5 to 0.5; the last good value stays in force'
    point.clear()
    assert [point.take() for _ in range(2)] == [0.0, 0.0]


def test_pairs_in_series_have_a_command_of_either_sign_each():
    logger = Logger()
    command = Command(SimpleNamespace(get_logger=lambda: logger), J_MAX, TIMEOUT, 3, topic='J')
    command.receive(heating(-99.0, 0.0, 2.0))
    assert command.at(0.0) == (-J_MAX, 0.0, 2.0) and command.clipped == 1
    command.receive(heating(1.0, 2.0))
    assert 'expected 3 numbers [W], one for each pair of wires, got 2' in command.refusal

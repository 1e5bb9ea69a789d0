"""The command in force: nothing that arrives is lost, at whatever moment the simulating thread looks."""

import threading
import time
from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed')
from sma_sim.ros.command import Command  # noqa: E402

J_MAX, TIMEOUT = 40.0, 0.5
ALTERNATIONS = 5_000
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
    assert command.at(0.0) == 0.0
    send(command, 5.0)
    send(command, 7.0)
    assert [command.at(t) for t in (1.0, 1.4, 1.5)] == [7.0] * 3 and not logger.warnings
    assert command.at(1.6) == 0.0 and command.at(9.0) == 0.0 and len(logger.warnings) == 1
    send(command, 3.0)
    command.clear()
    assert command.at(10.0) == 0.0


@pytest.mark.parametrize('value', [5.0, -60.0])
def test_a_command_that_arrives_while_the_heating_is_turned_off_is_kept(value):
    logger = Logger()
    command = command_with(logger)
    send(command, 9.0)
    assert command.at(0.0) == 9.0
    logger.hook = lambda: (setattr(logger, 'hook', lambda: None), send(command, value))
    assert command.at(1.0) == 0.0
    assert command.at(1.001) == command.at(1.4) == max(value, -J_MAX)


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
            value = command.at(t)
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

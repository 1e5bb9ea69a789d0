"""The page of `sma-sim explore` beside a running node: listen, record, the node goes and comes back."""

import contextlib
import signal
import subprocess
import sys

import pytest
from explore_server import serving, until

ros_client = pytest.importorskip('ros_client', reason='no ROS here')

WORDS = ('check.burn_in=0.5', 'check.window=0.5')
STATE = 'return smaExplore.robot.state'
PATIENCE = 120.0  # [s]


def wait(browser, condition):
    until(browser, f'const one = smaExplore.robot.state; return {condition}', seconds=PATIENCE)


@contextlib.contextmanager
def node_again(environment):
    """The same node, restarted where it was."""
    command = [sys.executable, '-m', 'sma_sim.ros.main', '--ros-args', '-r', '__ns:=/robot_1']
    output = subprocess.DEVNULL
    with subprocess.Popen(command, cwd=ros_client.ROOT, env=environment, stdout=output, stderr=output) as process:
        yield
        process.send_signal(signal.SIGINT)


@pytest.mark.slow
def test_beside_a_node_that_is_recorded_goes_and_comes_back(browser, tmp_path):
    with serving(tmp_path / 'session', words=WORDS) as server:
        try:
            with ros_client.Simulation('-r', '__ns:=/robot_1') as robot:
                browser.get(server.address)
                listen(browser, robot)
                wait(browser, 'one.state === "comparing" && smaExplore.robot.charts.size >= 10')
                browser.find_element('id', 'record').click()
                wait(browser, 'one.recording.messages > 200')
                browser.find_element('id', 'record').click()
                wait(browser, 'one.recording.path === ""')
                until(browser, 'return smaExplore.state.steps.recorded.length === 1', seconds=PATIENCE)
                assert browser.execute_script(STATE)['problems'] == []
                in_order = '.every((one, k, all) => k === 0 || one.stamp > all[k - 1].stamp)'
                assert browser.execute_script(f'return smaExplore.robot.samples{in_order}')
                robot.process.kill()  # a node that dies says nothing
                wait(browser, 'one.problems.some((words) => words.includes("joint_states"))')
                assert 'joint_states' in browser.find_element('id', 'robot-problems').text
            count = browser.execute_script(STATE)['compared']
            with node_again(robot.environment):
                wait(browser, f'one.compared > {count} + 20 && one.problems.length === 0')
                browser.find_element('id', 'listen-end').click()
                wait(browser, 'one.state === "ended"')
            browser.find_element('id', 'use-recorded').click()
            until(browser, 'return smaExplore.state.steps.data?.data.length === 1')
            browser.execute_script('document.querySelector("[data-begin=check]").click()')
            until(browser, 'return smaExplore.state.steps.stages[0].job?.state === "done"', seconds=PATIENCE)
            (run,) = server.application.data.engine.latest('check').result()['runs']
            assert {'U_x', 'U_y', 'alpha', 'F_1', 'T_2'} <= set(run['channels']) and run['samples'] > 20
        finally:
            server.application.close()


def listen(browser, robot):
    """Listen to a node in its namespace and domain."""
    until(browser, 'return window.smaExplore?.ready')
    browser.find_element('id', 'view-robot').click()
    browser.find_element('id', 'namespace').send_keys('robot_1')
    browser.find_element('id', 'domain').send_keys(robot.environment['ROS_DOMAIN_ID'])
    browser.find_element('id', 'listen').click()


def test_what_is_changed_acts_at_once_also_on_what_was_measured(browser, tmp_path):
    """A node with gravity beside a model without: switched on, it is in all that is shown, and undone it is not."""
    with serving(tmp_path / 'session', words=(*WORDS, 'check.noise_alpha=1e-4')) as server:
        try:
            with ros_client.Simulation('-p', 'effects.active:=[gravity]', '-r', '__ns:=/robot_1') as robot:
                browser.get(server.address)
                listen(browser, robot)
                wait(browser, 'one.state === "comparing" && smaExplore.robot.samples.length > 40')
                largest = 'Math.max(...smaExplore.robot.samples.map((sample) => Math.max(...sample.error.slice(0, 3))))'
                assert browser.execute_script(f'return {largest}') > 5.0
                heard = browser.execute_script('return smaExplore.robot.samples.at(-20).stamp')
                browser.find_element('id', 'tab-effects').click()
                browser.execute_script('document.querySelector("[data-effect=gravity] input").click()')
                wait(browser, 'one.model.version === 2 && smaExplore.robot.samples.length > 40')
                assert browser.execute_script('return smaExplore.robot.samples[0].stamp') < heard  # under the model before
                assert browser.execute_script(f'return {largest}') < 1e-3
                assert 'with version 2' in browser.find_element('id', 'robot-state').text
                browser.find_element('id', 'undo').click()
                wait(browser, f'one.model.version === 1 && smaExplore.robot.samples.length > 40 && {largest} > 5')
        finally:
            server.application.close()


@pytest.mark.slow
def test_without_a_robot_the_page_waits(browser, tmp_path):
    with serving(tmp_path / 'session', words=WORDS) as server:
        try:
            browser.get(server.address)
            until(browser, 'return window.smaExplore?.ready')
            browser.find_element('id', 'view-robot').click()
            browser.find_element('id', 'namespace').send_keys('nobody')
            browser.find_element('id', 'listen').click()
            wait(browser, 'one.state === "waiting for joint_states"')
            browser.refresh()
            until(browser, 'return window.smaExplore?.ready')
            browser.find_element('id', 'view-robot').click()
            wait(browser, 'one.state === "waiting for joint_states"')
            browser.find_element('id', 'listen-end').click()
            wait(browser, 'one.state === "ended"')
        finally:
            server.application.close()


@pytest.mark.slow
def test_what_has_changed_is_shown_and_a_version_with_it_follows(browser, tmp_path):
    """A node with gravity beside a model without: its cause, and one click to a model that follows."""
    with serving(tmp_path / 'session', words=(*WORDS, 'check.diagnosis_period=2')) as server:
        try:
            with ros_client.Simulation('-p', 'effects.active:=[gravity]', '-r', '__ns:=/robot_1') as robot:
                browser.get(server.address)
                listen(browser, robot)
                until(browser, 'return document.getElementById("use-cause") !== null', seconds=PATIENCE)
                assert 'gravity' in browser.find_element('id', 'robot-cause').text
                browser.find_element('id', 'use-cause').click()
                until(browser, 'return smaExplore.state.controls.active.includes("gravity")', seconds=PATIENCE)
                wait(browser, 'one.model.version === 2 && one.causes.length > 0 && !one.causes.at(-1).changed')
                until(browser, 'return document.getElementById("use-cause") === null', seconds=PATIENCE)
        finally:
            server.application.close()

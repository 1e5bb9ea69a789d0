"""Messages that the simulating thread takes by itself: the executor leaves them, and none is lost to one that is broken."""

import time

import pytest

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402
from std_msgs.msg import Float64  # noqa: E402

from sma_sim.ros.graph_check import GraphCheck  # noqa: E402
from sma_sim.ros.inbox import MAX_AT_ONCE, Inbox, clock_inbox  # noqa: E402

BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


def until(condition):
    """Return when the condition holds, and fail when it never does."""
    end = time.monotonic() + ros_client.REACTION
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


@pytest.fixture
def node():
    with ros_client.listener(ros_client.any_domain()) as made:
        yield made


@pytest.fixture
def executor(node):
    made = SingleThreadedExecutor(context=node.context)
    made.add_node(node)
    yield made
    made.shutdown()


def test_messages_wait_for_the_one_who_takes_them(node, executor):
    seen = []
    inbox = Inbox(node)
    inbox.add(node.create_subscription(Float64, 'x', seen.append, 10))
    publisher = node.create_publisher(Float64, 'x', 10)
    until(lambda: publisher.get_subscription_count() > 0)
    for number in (1.0, 2.0):
        publisher.publish(Float64(data=number))
    inbox.wait(ros_client.REACTION)
    executor.spin_once(timeout_sec=0.1)
    assert seen == []
    until(lambda: inbox.take() or len(seen) == 2)
    assert [message.data for message in seen] == [1.0, 2.0]


def test_messages_of_several_topics_are_taken_in_the_order_of_their_arrival(node):
    """The last of a command on `J_eq` and one on `J_eq_stamped` is in force, however long a clock stands still."""
    seen, publishers, inbox = [], [], Inbox(node)
    for topic in ('x', 'y'):
        inbox.add(node.create_subscription(Float64, topic, seen.append, 10))
        publishers.append(node.create_publisher(Float64, topic, 10))
    until(lambda: all(publisher.get_subscription_count() > 0 for publisher in publishers))
    for number, at in enumerate((1, 0, 1, 0)):
        publishers[at].publish(Float64(data=float(number)))
        time.sleep(0.1)
    inbox.take()
    assert [message.data for message in seen] == [0.0, 1.0, 2.0, 3.0]


def test_a_message_that_cannot_be_read_is_logged(node):
    seen, logged = [], []

    class Handle:
        """Gives an error, a message, and nothing more."""

        given = iter((ValueError('broken'), (Float64(data=3.0), {'received_timestamp': 1}), None))

        def take_message(self, *_):
            taken = next(self.given)
            if isinstance(taken, Exception):
                raise taken
            return taken

        def __enter__(self):
            return None

        def __exit__(self, *_):
            return None

    class Subscription:
        handle, msg_type, raw, topic_name, event_handlers = Handle(), Float64, False, '/x', ()
        qos_profile = BEST_EFFORT
        callback = staticmethod(seen.append)

    node.get_logger = lambda: type('Logger', (), {'error': staticmethod(logged.append)})
    inbox = Inbox(node)
    inbox.add(Subscription())
    inbox.take()
    assert logged == ['a message on /x was lost: broken'] and seen == []
    inbox.take()
    assert [message.data for message in seen] == [3.0] and len(logged) == 1


@pytest.mark.parametrize(('history', 'most'), [(HistoryPolicy.KEEP_LAST, 10), (HistoryPolicy.KEEP_ALL, MAX_AT_ONCE)])
def test_a_flood_ends_with_what_could_wait(node, history, most):
    """Messages that arrive faster than they are taken: steps must be made between them."""
    seen = []
    inbox = Inbox(node)
    inbox.add(node.create_subscription(Float64, 'x', seen.append, QoSProfile(depth=10, history=history)))
    publisher = node.create_publisher(Float64, 'x', QoSProfile(depth=10, history=history))
    until(lambda: publisher.get_subscription_count() > 0)

    def another(message):
        seen.append(message)
        assert len(seen) <= most
        publisher.publish(message)
        inbox.wait(0.2)  # it has arrived, as a rule

    inbox.subscriptions[0].callback = another
    publisher.publish(Float64(data=1.0))
    until(lambda: inbox.take() or seen)
    assert 1 <= len(seen) <= most


def test_a_clock_is_followed_only_when_it_is_taken(node, executor):
    assert clock_inbox(node).subscriptions == []
    node.set_parameters([ros_client.rclpy.Parameter('use_sim_time', value=True)])
    inbox = clock_inbox(node)
    publisher = node.create_publisher(Clock, '/clock', 10)
    until(lambda: publisher.get_subscription_count() > 0)
    message = Clock()
    message.clock.sec = 7
    publisher.publish(message)
    inbox.wait(ros_client.REACTION)
    executor.spin_once(timeout_sec=0.1)
    assert node.get_clock().now().nanoseconds == 0
    until(lambda: inbox.take() or node.get_clock().now().nanoseconds == 7 * 10**9)


def test_publishers_from_which_nothing_arrives_are_told(node):
    subscription = node.create_subscription(Float64, 'x', lambda _: None, 10)
    check = GraphCheck(node, [], {}, subscriptions=[subscription])
    node.create_publisher(Float64, 'x', 10)
    until(lambda: node.count_publishers('x') == 1)
    assert check.problems() == []
    node.create_publisher(Float64, 'x', BEST_EFFORT)
    until(lambda: node.count_publishers('x') == 2)
    (words,) = check.problems()
    assert words.startswith('nothing arrives on /x from listener: ') and 'qos_overrides' in words

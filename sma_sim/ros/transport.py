"""How the processes of a robot talk to each other: over UDP.

Fast DDS talks through shared memory where it can. A publisher may then wait a second for a listener that was killed, a
robot's driver for its observer or a guard for its controller, and the heating stays as it is meanwhile.
"""

from __future__ import annotations

import os
from collections.abc import Mapping

TRANSPORTS, OVER_UDP = 'FASTDDS_BUILTIN_TRANSPORTS', 'UDPv4'  # read by Fast DDS when a participant is made
RANGE, SHARED = 'ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST'  # with it shared memory is back, whatever TRANSPORTS says


def prefer_udp() -> None:
    """Let this process and those that it starts talk over UDP, where the environment does not say how."""
    os.environ.setdefault(TRANSPORTS, OVER_UDP)


def late_commands(environment: Mapping[str, str]) -> str:
    """Which setting of an environment lets commands wait for killed listeners, in words; empty where none does."""
    chosen = environment.get(TRANSPORTS, OVER_UDP)
    if environment.get(RANGE) == SHARED:
        setting = f'{RANGE}={SHARED}'
    elif not chosen.startswith('UDP'):
        setting = f'{TRANSPORTS}={chosen}'
    else:
        return ''
    return f'{setting}: Fast DDS may use shared memory, and commands wait up to a second for a listener that was killed'

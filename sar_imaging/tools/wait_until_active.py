# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Wait until nodes are active, so that what follows finds them ready for pulses.

Run: ros2 run sar_imaging wait_until_active pulse_buffer backprojection
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lifecycle_msgs.srv import GetState
    from rclpy.client import Client
    from rclpy.node import Node

_ASK_EVERY_S = 0.2
_ANSWER_S = 2.0
_TELL_EVERY_S = 10.0


def parser() -> argparse.ArgumentParser:
    """Command line of this program."""
    p = argparse.ArgumentParser(
        prog='wait_until_active', description='Wait until managed nodes are active. Ends with '
        'status 0 when all of them are, with 1 when the time is over.')
    p.add_argument('nodes', nargs='+', metavar='NODE', help='name of a node, such as '
                   'backprojection or /radar1/backprojection')
    p.add_argument('--timeout', type=float, default=0.0, metavar='SECONDS',
                   help='longest wait; 0 for as long as it takes (default)')
    return p


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; returns the exit status."""
    import rclpy
    from rclpy.executors import ExternalShutdownException
    from rclpy.signals import uninstall_signal_handlers
    from rclpy.utilities import remove_ros_args

    arguments = sys.argv if argv is None else ['wait_until_active', *argv]
    options = parser().parse_args(remove_ros_args(arguments)[1:])
    rclpy.init(args=list(arguments))
    try:
        return _wait(rclpy.create_node('wait_until_active'), options.nodes, options.timeout)
    except (KeyboardInterrupt, ExternalShutdownException):
        return 130
    finally:
        uninstall_signal_handlers()  # before what its thread wakes is destroyed
        rclpy.try_shutdown()


def _wait(asking: Node, names: Sequence[str], timeout_s: float) -> int:
    """Ask the nodes for their states, by a node of this program, until all are active."""
    from lifecycle_msgs.msg import State
    from lifecycle_msgs.srv import GetState

    log = asking.get_logger()
    waiting = {name: asking.create_client(GetState, f'{name}/get_state') for name in names}
    started = told = time.monotonic()
    while waiting:
        for name, client in list(waiting.items()):
            if _state(asking, client, GetState.Request()) == State.PRIMARY_STATE_ACTIVE:
                del waiting[name]
        now = time.monotonic()
        if waiting and timeout_s and now > started + timeout_s:
            log.error(f'{", ".join(waiting)} not active after {timeout_s:g} s')
            return 1
        if waiting and now > told + _TELL_EVERY_S:
            told = now
            log.info(f'waiting until {", ".join(waiting)} is active')
    log.info(f'{", ".join(names)} active')
    return 0


def _state(node: Node, client: Client, request: GetState.Request) -> int | None:
    """State of a node; None where it does not answer."""
    import rclpy

    if not client.wait_for_service(_ASK_EVERY_S):
        return None
    future = client.call_async(request)
    rclpy.spin_until_future_complete(node, future, timeout_sec=_ANSWER_S)
    if not future.done():
        client.remove_pending_request(future)
        return None
    time.sleep(_ASK_EVERY_S)  # a node that is busy compiling is not to be asked all the time
    return future.result().current_state.id


if __name__ == '__main__':
    sys.exit(main())

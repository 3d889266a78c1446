# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Steps without a node: their parameters, their counters and log, what they publish."""

import contextlib
import types

from sar_imaging.nodes.runtime.health import Tally
from sar_imaging.nodes.runtime.stage import COMMON_PARAMETERS


class Log(Tally):
    """Counters of a step, and its log lines."""

    def __init__(self, step):
        super().__init__(step.NAME, counters=(*step.COUNTERS, *step.FAULTS), faults=step.FAULTS)
        self.lines = []
        self.info = self.warning = self.error = self.lines.append

    def __getitem__(self, key):
        return float({v.key: v.value for v in self.status('').values}[key])


class Outputs:
    """What a step sees of its node: publishers that keep what they get."""

    def __init__(self, *listened):
        self.sent, self.joined = {}, {}
        self.listened = set(listened)
        self.activity = contextlib.ExitStack()
        self.context = types.SimpleNamespace(ok=lambda: True)

    def create_output(self, message_type, topic, qos, joined=lambda: None):
        self.sent[topic], self.joined[topic] = [], joined
        return types.SimpleNamespace(
            topic_name=f'/{topic}', publish=self.sent[topic].append,
            get_subscription_count=lambda: int(topic in self.listened))

    def repeat(self, period_s, call):
        pass

    def in_worker(self, work):
        work()

    def join(self, topic):
        self.listened.add(topic)
        self.joined[topic]()


def make(step, **parameters):
    """Step and its log; parameters beside the defaults."""
    values = {p.name: p.default for p in (*step.PARAMETERS, *COMMON_PARAMETERS)}
    log = Log(step)
    return step.create(values | {'pulses_per_aperture': 100} | parameters, log), log

# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""A radar that flies on for ever: one recorded aperture sent again and again to node processes."""

import dataclasses
import time

import numpy as np
import pytest

from msg_conversions.images import complex_from_message, map_metadata_from_message
from sar_imaging.recordings import bag_io

LARGEST_ERROR_DB = {'image': -80.0, 'subapertures': -60.0}  # what is planned for by default
# From the first image. Sums of float32 in another order: 1e-6. The plan of AFBP depends on how
# its track was foreseen, so images differ by their errors. One missing pulse of 200: 5e-3.
LARGEST_DIFFERENCE = {'image': 1e-4, 'subapertures': 2e-3}
BLOCK = 25  # pulses in a message
PACE_S = 0.02  # between messages; an aperture of eight takes a sixth of a second
MOST_UNDERWAY = 16  # messages; more would be a test of the machine's speed
MOST_APERTURES = 400  # sent while one image is awaited: it is not only late then
DEAF_S = 0.5  # between messages while more are underway: a node may be down
SECOND_NS = 10**9


class Flight:
    """A recording of one aperture, sent again and again as if the radar went on for ever.

    Aperture n has the counters of the recording plus n apertures and is n seconds later, so every
    complete image has the same pixels and is known by its stamp.
    """

    def __init__(self, chain, recording, mode):
        self.chain, self.observer = chain, chain.observer
        self.imager = chain.names[-1]
        self.largest_difference = LARGEST_DIFFERENCE[mode]
        self.blocks = recording.blocks(BLOCK)
        self.length = recording.truth['pulses_per_aperture']
        first, last = (int(t) for t in recording.pulses.stamp_ns[[0, -1]])
        self.first_ns = (first + last) // 2
        self.aperture = 0
        self.clock_s = 0  # of the radar, besides one second per aperture
        self.damage = bytes  # of a serialised message, on its way
        self.n_sent = 0
        self._queue = []
        self._newest = 0  # counter sent
        self._sent_s = 0.0
        # The first image is compared with the exact one, the others with the first.
        self.reference = complex_from_message(
            self.fly(lambda: self.image_at(self.first_ns), 'the first image'))
        [metadata, *_] = self.observer.wait_for('map_metadata', 1)
        assert recording.error_db(self.reference, map_metadata_from_message(metadata),
                                  np.arange(self.length)) < LARGEST_ERROR_DB[mode]

    def block(self, index):
        """One block of the current aperture."""
        block = self.blocks[index]
        shift_ns = (self.aperture + self.clock_s) * SECOND_NS
        return dataclasses.replace(
            block, counter=block.counter + np.uint32(self.aperture * self.length),
            stamp_ns=block.stamp_ns + shift_ns)

    @property
    def stamp_ns(self):
        """Time of the middle of the current aperture."""
        return self.first_ns + (self.aperture + self.clock_s) * SECOND_NS

    def next_block(self):
        """The message to be sent next; the next aperture follows the last one."""
        if not self._queue:
            self._queue = list(range(len(self.blocks)))
        block = self.block(self._queue.pop(0))
        self._newest = int(block.counter[-1])
        self.n_sent += 1
        self.aperture += not self._queue
        return block

    def send_next(self):
        """Send the next message."""
        self.observer.send([self.damage(bag_io.serialise(self.next_block()))])

    def begin_again(self):
        """The counters begin anew."""
        self.aperture, self._queue = 0, []

    def fly(self, condition, what):
        """Send at the radar's pace until a condition holds; returns its value.

        Waits as long as the nodes make progress, whatever the machine, but not for ever.
        """
        most = self.n_sent + MOST_APERTURES * len(self.blocks)

        def step():
            if self.n_sent >= most:
                pytest.fail(f'{MOST_APERTURES} apertures were sent without {what}')
            pause = PACE_S if self._underway() <= MOST_UNDERWAY * BLOCK else DEAF_S
            if time.monotonic() >= self._sent_s + pause:
                self.send_next()
                self._sent_s = time.monotonic()
            return condition()

        return self.observer.wait(step, what, progress=self._progress)

    def _progress(self):
        """What the nodes have done so far; sending alone is none."""
        messages = self.observer.messages
        return (len(messages['image_complex']), len(messages[f'{self.imager}/progress']))

    def _underway(self):
        """Pulses sent that the last node has not finished."""
        progress = self.observer.messages[f'{self.imager}/progress']
        return self._newest - progress[-1].data if progress else self._newest

    def fly_messages(self, count):
        """Send so many messages, and at least one, at the radar's pace."""
        last = self.n_sent + count
        self.fly(lambda: self.n_sent >= last, 'messages to be sent')

    def finish_aperture(self):
        """Send the rest of the aperture at once."""
        while self._queue:
            self.send_next()

    def image_at(self, stamp_ns, since=0):
        """Message with a stamp among those that came `since`, None when there is none."""
        for message in self.observer.messages['image_complex'][since:]:
            stamp = message.header.stamp
            # Stamps of the recording are rounded to 1 ns, and so is the middle of its ends.
            if abs(stamp.sec * SECOND_NS + stamp.nanosec - stamp_ns) <= 2:
                return message
        return None

    def error(self, message):
        """Difference of an image from the first one, relative."""
        image = complex_from_message(message)
        return np.linalg.norm(image - self.reference) / np.linalg.norm(self.reference)

    def assert_next_aperture_right(self, what):
        """Send the next whole aperture; its image must come and be right."""
        self.finish_aperture()
        since, stamp_ns = len(self.observer.messages['image_complex']), self.stamp_ns
        image = self.fly(lambda: self.image_at(stamp_ns, since), f'the aperture after {what}')
        assert self.error(image) < self.largest_difference, what

    def wait_for_complete_image(self, first_aperture, what):
        """Send until an image of this aperture or a later one is right; returns its number."""
        def complete():
            images = {n: self.image_at(self.first_ns + n * SECOND_NS)
                      for n in range(first_aperture, self.aperture + 1)}
            return [n for n, image in images.items()
                    if image is not None and self.error(image) < self.largest_difference]

        return self.fly(complete, f'a complete aperture after {what}')[0]

"""Settings of all tests."""

import signal

from hypothesis import settings

# The first call of a test may compile a kernel or import half of rclpy: tests are not timed.
settings.register_profile('untimed', deadline=None)
settings.load_profile('untimed')

# A shell starts background jobs with SIGINT ignored, which children inherit; the tests of Ctrl-C
# need what a terminal gives.
signal.signal(signal.SIGINT, signal.default_int_handler)

"""Settings of all tests."""

from hypothesis import settings

# The first call of a test may compile a kernel or import half of rclpy: tests are not timed.
settings.register_profile('untimed', deadline=None)
settings.load_profile('untimed')

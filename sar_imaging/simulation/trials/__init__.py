"""Random radars, flights and track errors from seeds, to test claims on."""

from .drone_flights import DroneFlight, drone_flight
from .random_cases import RandomCase, random_case
from .track_errors import FlawedAperture, flawed_aperture

__all__ = ['DroneFlight', 'FlawedAperture', 'RandomCase', 'drone_flight', 'flawed_aperture',
           'random_case']

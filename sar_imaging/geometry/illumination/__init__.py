"""Which points a radar lights, and how brightly: antenna patterns and their pointing by pulse.

Images with illumination are ``f(x) = sum_m sum_n w_mn(x) s_mn(D_mn(x)) exp(+j k_c D_mn(x))``, with
the two-way amplitude w_mn(x) of pulse m and channel n towards the point x, seen from the middle
between the channel's phase centres. Points that a pulse does not light take no part.

- `pattern`: amplitude over azimuth and elevation off boresight;
- `pointing`: boresight and up direction of each pulse;
- `echoes`: both together, for the echoes of some pulses;
- `antenna`, `mount`: both as data sheets, parameter files and recordings describe them.
"""

from .antenna import Antenna
from .echoes import NO_SPREAD, AmplitudeSpread, Illumination
from .mount import Mount
from .pattern import AntennaPattern, PatternCut
from .pointing import Pointing

__all__ = ['NO_SPREAD', 'AmplitudeSpread', 'Antenna', 'AntennaPattern', 'Illumination', 'Mount',
           'PatternCut', 'Pointing']

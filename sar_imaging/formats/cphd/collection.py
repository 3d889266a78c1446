# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Who collected a CPHD file, what, how and when: what no samples tell."""

from __future__ import annotations

import dataclasses
import datetime

from ..acquisition import EPOCH, UNKNOWN
from .container import Container, CphdError

MODES = ('SPOTLIGHT', 'STRIPMAP', 'DYNAMIC STRIPMAP')
COLLECT_TYPES = ('MONOSTATIC', 'BISTATIC')
POLARISATIONS = ('X', 'Y', 'V', 'H', 'S', 'E', 'RHC', 'LHC', 'UNSPECIFIED')


@dataclasses.dataclass(frozen=True)
class Collection:
    """Names and kinds that a CPHD file has to tell beside its samples.

    Parameters
    ----------
    collector_name, core_name : str
        Collector name and core name of the sensor, and of this collection.
    illuminator_name : str
        Illuminator name of a transmitter of its own; empty where there is none.
    collect_type : {'', 'MONOSTATIC', 'BISTATIC'}
        Empty: found from the distance of transmitter and receiver.
    mode_type : {'SPOTLIGHT', 'STRIPMAP', 'DYNAMIC STRIPMAP'}
        How the beam was steered.
    mode_id, country_code : str
        Empty where not told.
    classification, release_info : str
        Marking of the file.
    channels : tuple of str
        Identifier of each channel; empty: ``Channel_1`` and so on.
    polarisations : tuple of (str, str)
        Transmitted and received of each channel; empty: ``UNSPECIFIED``.

    Raises
    ------
    CphdError
        A kind is not one of the standard, or a text is empty that must not be.

    Examples
    --------
    >>> from sar_imaging.formats.cphd import Collection, CphdError
    >>> names = Collection(collector_name='drone 7', core_name='flight 12', mode_type='STRIPMAP')
    >>> names.named(2).channels
    ('Channel_1', 'Channel_2')
    >>> try:
    ...     Collection(mode_type='SPOTLIGHTS')
    ... except CphdError as error:
    ...     print(error)
    mode_type='SPOTLIGHTS'; expected one of SPOTLIGHT, STRIPMAP, DYNAMIC STRIPMAP
    """

    collector_name: str = UNKNOWN
    core_name: str = UNKNOWN
    illuminator_name: str = ''
    collect_type: str = ''
    mode_type: str = 'SPOTLIGHT'
    mode_id: str = ''
    country_code: str = ''
    classification: str = 'UNCLASSIFIED'
    release_info: str = 'UNRESTRICTED'
    channels: tuple[str, ...] = ()
    polarisations: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        texts = [getattr(self, f.name) for f in dataclasses.fields(self)[:-2]]
        if isinstance(self.channels, str) or not all(
                isinstance(text, str) for text in [*texts, *self.channels]):
            raise CphdError('names of a collection are no texts; expected texts, channels a '
                            'tuple of them')
        object.__setattr__(self, 'channels', tuple(self.channels))
        object.__setattr__(self, 'polarisations', tuple(map(tuple, self.polarisations)))
        for name in ('collector_name', 'core_name', 'classification', 'release_info'):
            if not getattr(self, name).strip():
                raise CphdError(f'{name} is empty; CPHD needs one')
        if self.mode_type not in MODES:
            raise CphdError(f'mode_type={self.mode_type!r}; expected one of {", ".join(MODES)}')
        if self.collect_type not in ('', *COLLECT_TYPES):
            raise CphdError(f'collect_type={self.collect_type!r}; expected one of '
                            f'{", ".join(COLLECT_TYPES)}, or none')
        if len(set(self.channels)) != len(self.channels):
            raise CphdError(f'channels={self.channels}; expected a name of its own for each')
        for pair in self.polarisations:
            if len(pair) != 2 or not set(pair) <= set(POLARISATIONS):
                raise CphdError(f'polarisation {pair}; expected two of '
                                f'{", ".join(POLARISATIONS)}')

    def named(self, n_channels: int) -> Collection:
        """The same with a name and polarisations for each of some channels.

        Raises
        ------
        CphdError
            It names another number of channels.
        """
        channels = self.channels or tuple(f'Channel_{i + 1}' for i in range(n_channels))
        polarisations = self.polarisations or (('UNSPECIFIED', 'UNSPECIFIED'),) * n_channels
        for name, given in (('channels', channels), ('polarisations', polarisations)):
            if len(given) != n_channels:
                raise CphdError(f'{name} are {len(given)}, the pulses have {n_channels} channels')
        return dataclasses.replace(self, channels=channels, polarisations=polarisations)


def read_collection(container: Container, channels: tuple[str, ...]) -> Collection:
    """Names and kinds that a file tells of some of its channels."""
    def text(path: str, default: str = '') -> str:
        return container.text(f'CollectionID/{path}', default)

    return Collection(
        collector_name=text('CollectorName', UNKNOWN), core_name=text('CoreName', UNKNOWN),
        illuminator_name=text('IlluminatorName'), collect_type=text('CollectType'),
        mode_type=text('RadarMode/ModeType', MODES[0]), mode_id=text('RadarMode/ModeID'),
        country_code=text('CountryCode'), classification=text('Classification', 'UNCLASSIFIED'),
        release_info=text('ReleaseInfo', 'UNRESTRICTED'), channels=channels,
        polarisations=tuple(_polarisation(container, name) for name in channels))


def _polarisation(container: Container, channel: str) -> tuple[str, str]:
    for node in container.tree.findall('{*}Channel/{*}Parameters'):
        if node.findtext('{*}Identifier') == channel:
            sent, received = (node.findtext(f'{{*}}Polarization/{{*}}{side}Pol')
                              for side in ('Tx', 'Rcv'))
            return _known(sent), _known(received)
    return ('UNSPECIFIED', 'UNSPECIFIED')


def read_start_ns(container: Container) -> int:
    """Time from which a file counts, nanoseconds since 1970, UTC."""
    text = container.text('Global/Timeline/CollectionStart')
    whole, point, rest = text.removesuffix('Z').partition('.')
    digits = rest or '0'
    try:
        moment = datetime.datetime.fromisoformat(whole)
        if not digits.isdecimal():
            raise ValueError(f'{point}{rest} is no part of a second')
    except ValueError as error:
        raise CphdError(f'{container.path}: CollectionStart is {text[:40]!r}: {error}') from error
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=datetime.timezone.utc)
    seconds = (moment - EPOCH) // datetime.timedelta(seconds=1)
    return seconds * 10**9 + int((digits + 9 * '0')[:9])


def _known(polarisation: str | None) -> str:
    return polarisation if polarisation in POLARISATIONS else 'UNSPECIFIED'

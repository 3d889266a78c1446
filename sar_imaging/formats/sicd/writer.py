# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Complex images to SICD files."""

from __future__ import annotations

import os

import numpy as np

from ...files import replacing
from ...geometry.earth import Datum
from ...imaging.image import Image
from ...radiometry import ImageResponse, KnotResponse, RadarConstant
from ...signal.radar import SPEED_OF_LIGHT
from ..acquisition import Acquisition
from ..extras import require
from . import container
from .layout import lay_out
from .metadata import Description, radiometric, sicd_tree
from .track import fit_track

_STATION = 'SARIMAGING'  # ten letters at most


def write_sicd(path: os.PathLike[str] | str, image: Image, datum: Datum,
               acquisition: Acquisition, *, pixel_type: str = container.FLOAT,
               classification: str = 'UNCLASSIFIED',
               response: ImageResponse | KnotResponse | None = None,
               constant: RadarConstant | None = None) -> None:
    """Write an image as SICD 1.3, bistatic ones as 1.4 (NGA.STND.0024).

    The image lies on a plane: a grid of `sicd_grid`, or a map, whose axes are exchanged and
    turned round until rows lead away from the radar. Pixels stay where they are, and floating
    point ones keep every bit.

    Parameters
    ----------
    path : path
        File to write, such as ``image.nitf``; complete or absent.
    image : Image
        One image, not one for each channel.
    datum : Datum
        Place of the imaging frame on the Earth.
    acquisition : Acquisition
        Pulses of the image.
    pixel_type : str
        ``'RE32F_IM32F'``, ``'RE16I_IM16I'`` or ``'AMP8I_PHS8I'``.
    classification : str
        Classification of the contents; its first letter goes to the NITF headers.
    response, constant : ImageResponse or KnotResponse, and RadarConstant, optional
        Response of the image (`sar_imaging.radiometry`) and constant of the radar: the file then
        has scale factors by which its pixels become cross sections, beta, sigma and
        gamma nought, whether the image is calibrated or not.

    Raises
    ------
    ValueError
        SICD does not describe such an image: on terrain, on an upright plane, aliased, of waves
        that do not travel as light does, of a radar that does not move. Or the image and the
        acquisition or the response do not belong together, or scale factors are no polynomials.
    MissingExtraError
        sarkit is not installed.

    Examples
    --------
    >>> import os
    >>> from sar_imaging import plan_image
    >>> from sar_imaging.formats import Acquisition, sicd_grid, write_sicd
    >>> from sar_imaging.geometry import Datum
    >>> from sar_imaging.recordings import read_blocks
    >>> block = next(read_blocks('bags/spotlight'))
    >>> acquisition = Acquisition.of(block, polarisation='V:V', collector='drone 7')
    >>> grid = sicd_grid(acquisition, (0.0, 0.0, 0.0), 8.0, 8.0)
    >>> image = plan_image(grid, block.radar, block.n_samples, compressed=False)(block)
    >>> write_sicd('image.nitf', image, Datum(47.0, 8.0, 450.0), acquisition)
    >>> os.path.getsize('image.nitf') > image.samples.nbytes
    True
    """
    sicd = require('sarkit.sicd', 'writing SICD')
    _check(image, acquisition)
    if (response is None) != (constant is None):
        raise ValueError('response and constant belong together; give both, or none')
    layout = lay_out(image.grid, acquisition)
    track = fit_track(acquisition, datum, layout.scp_m)
    stored, amplitudes, scale = container.encoded(layout.at_baseband(image.samples), pixel_type)
    factors = (None if response is None or constant is None else
               radiometric(image, layout, response, constant, scale))
    tree = sicd_tree(Description(layout, track, acquisition, datum, pixel_type, amplitudes, scale,
                                 classification, factors, image.radiometry))
    security = sicd.NitfSecurityFields(clas=_letter(classification))
    metadata = sicd.NitfMetadata(
        xmltree=tree,
        file_header_part=sicd.NitfFileHeaderPart(ostaid=_STATION, security=security),
        im_subheader_part=sicd.NitfImSubheaderPart(isorce=acquisition.collector[:42],
                                                   security=security),
        de_subheader_part=sicd.NitfDeSubheaderPart(security=security))
    with replacing(path) as part, open(part, 'wb') as file, \
            sicd.NitfWriter(file, metadata) as writer:
        writer.write_image(stored)


def _letter(classification: str) -> str:
    letter = classification[:1].upper()
    if letter not in ('U', 'R', 'C', 'S', 'T'):
        raise ValueError(f'classification={classification!r}; expected UNCLASSIFIED, RESTRICTED, '
                         'CONFIDENTIAL, SECRET or TOP SECRET')
    return letter


def _check(image: Image, acquisition: Acquisition) -> None:
    radar = acquisition.radar
    if abs(radar.propagation_speed_m_per_s / SPEED_OF_LIGHT - 1) > 1e-3:
        raise ValueError(f'the waves travel at {radar.propagation_speed_m_per_s:g} m/s; SICD '
                         'describes radar in air: write a GeoTIFF')
    if abs(radar.carrier_hz - image.carrier_hz) > 1e-6 * image.carrier_hz:
        raise ValueError(f'the image has the carrier {image.carrier_hz:g} Hz, the acquisition '
                         f'{radar.carrier_hz:g} Hz; expected the acquisition of this image')
    if np.ndim(image.samples) != 2:
        raise ValueError(f'image.samples.shape={image.shape}; expected (rows, columns): write '
                         'the image of each channel into a file of its own')
    if image.n_pulses and image.n_pulses != acquisition.n_pulses:
        raise ValueError(f'the image is of {image.n_pulses} pulses, the acquisition has '
                         f'{acquisition.n_pulses}; expected those of the image')

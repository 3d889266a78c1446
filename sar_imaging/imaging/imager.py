# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""One way to an image: `plan_image` chooses the imager, and all of them are used alike."""

from __future__ import annotations

import dataclasses
import functools
import logging
import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike

from ..backends import AUTO, CUDA, DeviceError, compilation_announced
from ..backends.samples import check_device_arrays, compress
from ..device_arrays import beside, on_device, to_host, zeros_beside
from ..geometry.grids import Grid, MapGrid, as_grid
from ..geometry.polar import PolarGrid
from ..memory import IMAGE_BYTES, check_memory
from ..planning.ambiguities import flight_warnings
from ..planning.profiles import BeyondPeriod
from ..signal.pulses import PulseBlock
from ..signal.radar import RadarParameters
from .darkness import Correlated, correlated, judged
from .image import Image, Report
from .methods import AFBP, EXACT, Method, Options, method_class

if TYPE_CHECKING:
    from ..backends.protocol import Backend
    from ..geometry.illumination import AntennaPattern, Pointing
    from ..signal.range_compression import RangeCompressor


class Channels:
    """Choice of what of the channels goes into an image.

    Parameters
    ----------
    weights : (C,) complex array_like, optional
        Factor of each channel, such as its calibration or the steering of a beam.
    per_channel : bool
        One image per channel instead of their sum.
    midpoint : bool
        Replace both phase centres of a channel by their mean: displaced phase centres.

    Raises
    ------
    ValueError
        The weights are no finite numbers.
    """

    def __init__(self, weights: ArrayLike | None = None, per_channel: bool = False,
                 midpoint: bool = False) -> None:
        self._weights = None if weights is None else np.asarray(weights, np.complex64)
        if self._weights is not None and (self._weights.ndim != 1
                                          or not np.isfinite(self._weights).all()):
            raise ValueError(f'weights={weights!s}; expected one finite complex number per '
                             'channel')
        self.per_channel, self.midpoint = per_channel, midpoint

    def shape(self, shape: tuple[int, ...], n_channels: int) -> tuple[int, ...]:
        """Of the image: that of one channel, or of all, one after the other."""
        return (n_channels, *shape) if self.per_channel else shape

    def centres(self, tx_m: np.ndarray, rx_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Phase centres as the image takes them, metres."""
        return (0.5 * (tx_m + rx_m),) * 2 if self.midpoint else (tx_m, rx_m)

    def cuts(self, n_channels: int) -> list[slice]:
        """Channels of each image."""
        return ([slice(n, n + 1) for n in range(n_channels)] if self.per_channel
                else [slice(None)])

    def blocks(self, block: PulseBlock) -> list[PulseBlock]:
        """Blocks of which each makes an image by itself.

        Raises
        ------
        ValueError
            There are more or fewer channels than weights.
        """
        if self._weights is not None and len(self._weights) != block.n_channels:
            raise ValueError(f'the block has {block.n_channels} channels, weights are for '
                             f'{len(self._weights)}; pass one weight per channel')
        if (block.tx_m is None or block.rx_m is None  # which the method refuses
                or self._weights is None and not (self.per_channel or self.midpoint)):
            return [block]
        samples, (tx, rx) = block.samples, self.centres(block.tx_m, block.rx_m)
        if self._weights is not None:
            samples = samples * beside(self._weights[:, None], samples)
        return [dataclasses.replace(block, samples=samples[:, cut], tx_m=tx[:, cut],
                                    rx_m=rx[:, cut]) for cut in self.cuts(block.n_channels)]


_logger = logging.getLogger(__name__)
# Time that planning AFBP takes (measured: 0.02 to 0.05 s), and of exact images for which it is
# tried: of quicker ones AFBP saves a fifth or less, not what its plan takes.
_PLANNING_S, _WORTH_PLANNING_S = 0.03, 0.1


def plan_image(grid: Grid | ArrayLike, radar: RadarParameters, n_samples: int,
               tx_m: ArrayLike | None = None, rx_m: ArrayLike | None = None, *,
               method: str | type[Method] = AUTO, target_db: float = -60.0,
               height_m: ArrayLike | None = None, weights: ArrayLike | None = None,
               per_channel: bool = False, midpoint: bool = False, compressed: bool = True,
               weighting: str = 'none', pulse_weights: ArrayLike | None = None,
               illumination: AntennaPattern | None = None, pointing: Pointing | None = None,
               backend: str | Backend = AUTO, progress: bool = False, **own: Mapping[str, Any]
               ) -> Imager:
    """Plan how pulses of a radar become images on a grid.

    Parameters
    ----------
    grid : Grid or (..., 3) array_like
        Where the pixels are: any grid of `sar_imaging.geometry`, or positions in the imaging
        frame, metres, float64.
    radar : RadarParameters
        Radar parameters of the blocks to come.
    n_samples : int
        Their samples.
    tx_m, rx_m : (P, C, 3) array_like, optional
        Phase centres of the pulses to come, metres: the imager is then chosen, and its plan made,
        before they come. Pulses from other places are planned for when they come.
    method : str or subclass of Method
        ``'exact'`` backprojection, ``'afbp'``, ``'ffbp'``, ``'wavenumber'``, ``'zero-padding'`` or
        ``'correlation'``; ``'auto'`` takes exact backprojection or AFBP, the one that is quicker
        and meets the target. A class of your own is used likewise, see docs/extending.md.
    target_db : float
        Wanted error against time-domain correlation, dB.
    height_m : (n_y, n_x) array_like, optional
        Heights of the pixels of a map instead of its plane, metres; row 0 at the largest y. NaN
        where the height is not known.
    weights : (C,) complex array_like, optional
        Factor of each channel, such as its calibration or the steering of a beam.
    per_channel : bool
        One image for each channel instead of their sum, ``(C, ...)``: the input of along-track
        interferometry and clutter cancelling.
    midpoint : bool
        Replace both phase centres of a channel by their mean (displaced phase centre). For
        comparison: the exact path costs no more.
    compressed : bool
        False when blocks hold raw pulses. AFBP and exact backprojection image phase histories
        as they are, the latter where their unambiguous range covers the grid; everything else is
        compressed first.
    weighting : str
        Spectral window of raw pulses, see `sar_imaging.signal.windows`.
    pulse_weights : (P,) array_like, optional
        Window over the pulses of a block.
    illumination : AntennaPattern, optional
        Two-way amplitude of the antenna by direction, with which each pulse adds to each pixel;
        pixels that it does not light take no part. Blocks then tell where the antenna looked,
        see `PulseBlock.pointing`.
    pointing : Pointing, optional
        Where the antenna looks at the pulses to come, with `tx_m` and `rx_m`.
    backend : str or Backend
        What computes it, see `sar_imaging.backends`: ``'cpu'``, ``'cuda'``, ``'reference'``;
        ``'auto'`` takes the quickest there is. An object with the four entries of a backend is
        used likewise. Methods of `sar_imaging.published` compute on the
        processor by themselves. Blocks whose samples lie on a CUDA device, as arrays of CuPy,
        are imaged there, and their images stay there.
    progress : bool
        Show a progress bar on standard error.
    **own
        Options of the method alone, see `sar_imaging.imaging.methods.Method.OWN`:
        ``pulses_per_subaperture`` of AFBP and FFBP, for instance.

    Returns
    -------
    Imager

    Raises
    ------
    ValueError
        There is no such method, it cannot do what is asked for, or the geometry does not allow
        the target.
    MemoryError
        The image does not fit into memory.

    Examples
    --------
    >>> from sar_imaging import MapGrid, concatenate, plan_image
    >>> from sar_imaging.simulation import SCENARIOS
    >>> profiles = concatenate(list(SCENARIOS['psf']().blocks()))
    >>> grid = MapGrid((10_000.0, 0.0, 0.0), n_x=24, n_y=24, spacing_m=0.5)
    >>> imager = plan_image(grid, profiles.radar, profiles.n_samples)
    >>> image = imager(profiles)
    >>> image.shape, image.report.method, bool(image.report.predicted_error_db < -60)
    ((24, 24), 'exact', True)
    """
    options = Options(float(target_db), compressed, weighting, cast(Any, pulse_weights), backend,
                      progress, illumination)
    imager = Imager(as_grid(grid, height_m), radar, n_samples, method, options,
                    Channels(weights, per_channel, midpoint), own)
    if tx_m is not None:
        imager.plan(tx_m, cast(Any, rx_m), pointing)
    return imager


class Imager:
    """Forms images by one method; `plan_image` makes it.

    Plans are kept: pulses from the same places as those before them are imaged by the same one,
    and a plan for others begins with the numbers of groups and parts of the one before.

    Attributes
    ----------
    grid : Grid
        Where the pixels are.
    radar, n_samples :
        As given to `plan_image`.
    method : str
        Name of the method, or ``'auto'``.
    report : Report or None
        Report of the latest plan or image; None before the first.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import MapGrid, plan_image
    >>> from sar_imaging.simulation import SCENARIOS
    >>> blocks = list(SCENARIOS['psf']().blocks(pulses_per_block=50))
    >>> grid = MapGrid((10_000.0, 0.0, 0.0), 25, 25, 0.5)
    >>> imager = plan_image(grid, blocks[0].radar, blocks[0].n_samples, method='exact')
    >>> image = imager.new_image(blocks[0].n_channels)
    >>> for block in blocks:  # as they arrive
    ...     imager.accumulate(block, image)
    >>> print(f'{image.n_pulses} pulses, peak {np.abs(image).max():.0f}')
    200 pulses, peak 1000
    """

    def __init__(self, grid: Grid, radar: RadarParameters, n_samples: int,
                 method: str | type[Method], options: Options, channels: Channels,
                 own: Mapping[str, object]):
        if method == AUTO and own:
            raise ValueError(f'{", ".join(sorted(own))}: options of one method, which method='
                             f'{AUTO!r} leaves open; name the method')
        self.grid, self.radar, self.n_samples = grid, radar, int(n_samples)
        self._asked = None if method == AUTO else method_class(method)
        self.method = AUTO if self._asked is None else self._asked.NAME
        self.report: Report | None = None
        self._told: set[str] = set()
        self._options, self._channels, self._own = options, channels, own
        self._check_memory(grid.shape)
        self._beyond_period = False  # phase histories, of which images need profiles therefore
        # Of each channel, or of all at 0; made now, to refuse what it cannot do.
        self._latest: dict[int, Method] = {}
        self._latest[0] = self._make(self._asked or method_class(EXACT))

    def __call__(self, block: PulseBlock) -> Image:
        """Image of one block.

        Parameters
        ----------
        block : PulseBlock
            Pulses with phase centres, in any order; each is added.

        Returns
        -------
        Image

        Raises
        ------
        ValueError
            The block is not of the radar that was planned for, has no phase centres, or the
            method cannot image it.
        MemoryError
            The image does not fit into memory.
        """
        image = self.new_image(block.n_channels, block.samples)
        if self._channels.per_channel or not block.n_pulses:
            self.accumulate(block, image)
        else:  # without a sum with zeros
            [block] = self._channels.blocks(block)
            image.samples, image.planned = self._formed(0, block)
            here = not (on_device(block.samples) or on_device(image.samples))
            self._count(block, image, functools.partial(self._correlated, block) if here else None)
        for warning in set(image.report.warnings) - self._told:
            _logger.warning(warning)
        self._told.update(image.report.warnings)
        return image

    def new_image(self, n_channels: int = 1, like: np.ndarray | None = None) -> Image:
        """Image without pulses, for `accumulate` of blocks of this number of channels.

        It lies on the device where the array `like` lies there, in the host's memory otherwise.

        Raises
        ------
        MemoryError
            It is larger than the memory that is available.
        """
        shape = self._channels.shape(self.grid.shape, n_channels)
        self._check_memory(shape)
        report = Report(self.method, 'no pulses yet', self._options.target_db)
        return Image(zeros_beside(shape, like), self.grid, self.radar.carrier_hz, report)

    def accumulate(self, block: PulseBlock, image: Image) -> None:
        """Add the pulses of a block to an image, which is a sum (equation 17), in place.

        Live images grow this way, block by block; an empty block adds nothing. An image that
        lies on the device stays there; the block may lie there or not.

        Raises
        ------
        ValueError
            As a call, or the image is not one that this imager formed.
        """
        blocks = self._channels.blocks(block)
        samples = image.samples
        wanted = self._channels.shape(self.grid.shape, block.n_channels)
        if (samples.shape != wanted or samples.dtype != np.complex64
                or not samples.flags.c_contiguous):
            raise ValueError(f'the image is {samples.dtype} {samples.shape}, that of the block '
                             f'complex64 {wanted}, contiguous in C order; add blocks to images '
                             'that the same imager formed')
        if not block.n_pulses:
            return
        images = samples if self._channels.per_channel else [samples]
        for number, (some, own) in enumerate(zip(blocks, images, strict=True)):
            _, report = self._formed(number, some, own)
            image.planned = _worse(image.planned or image.report, report,
                                   first=not image.n_pulses and number == 0)
        self._count(block, image)

    def plan(self, tx_m: ArrayLike, rx_m: ArrayLike, pointing: Pointing | None = None) -> Report:
        """Choose the method and plan for pulses from some phase centres, (P, C, 3), metres.

        `pointing` tells where the antenna looks at them, for images with illumination.

        Raises
        ------
        ValueError
            The geometry does not allow the target.
        MemoryError
            The image does not fit into memory.
        """
        tx_m, rx_m = self._channels.centres(np.asarray(tx_m, np.float64),
                                            np.asarray(rx_m, np.float64))
        reports = [self._planned(number, tx_m[:, cut], rx_m[:, cut], pointing).report
                   for number, cut in enumerate(self._channels.cuts(tx_m.shape[1]))]
        self.report = reports[0]
        return self.report

    def _count(self, block: PulseBlock, image: Image,
               reference: Callable[[], Correlated] | None = None) -> None:
        """Take note in an image which pulses it has got, and what is known of it by now."""
        middle = int(np.sort(block.stamp_ns)[block.n_pulses // 2])
        image.stamp_ns += ((middle - image.stamp_ns) * block.n_pulses
                           // (image.n_pulses + block.n_pulses))
        image.counters = np.sort(np.concatenate([image.counters, block.counter.astype(np.int64)]))
        planned = cast(Report, image.planned)
        self.report = image.report = judged(planned, image.samples, self.grid, reference)

    def _correlated(self, block: PulseBlock) -> Correlated:
        """What the latest image, of this block, should be."""
        latest = self._latest[0]
        if latest.options.compressed and not self._options.compressed:
            block = self._compressor(block)
        return correlated(latest, block)

    def _formed(self, number: int, block: PulseBlock, onto: np.ndarray | None = None
                ) -> tuple[np.ndarray, Report]:
        """Image of the block of one channel, or of all, added to one if there is one."""
        if not block.has_positions:
            raise ValueError('the block has no phase centres; imaging needs the transmit and '
                             'receive position of every pulse and channel')
        if on_device(block.samples) or on_device(onto):
            if self._options.backend == AUTO:
                return self._formed_there(number, block, onto)
            check_device_arrays(self._options.backend)
        with compilation_announced():
            where = block.tx_m, block.rx_m, block.pointing
            planned = self._planned(number, *where)
            if self._asked is None and planned.NAME != EXACT:
                samples, report = self._image(planned, block)
                predicted_db = report.predicted_error_db
                missed_db = 0.0 if predicted_db is None else predicted_db - self._options.target_db
                if missed_db <= 0:
                    return (samples if onto is None else np.add(onto, samples, out=onto)), report
                planned = self._plan_anew(
                    number, method_class(EXACT), where, f'{planned.NAME} would miss the target by '
                    f'{missed_db:.1f} dB: the surroundings are bright')
            return self._image(planned, block, onto)

    def _formed_there(self, number: int, block: PulseBlock, onto: np.ndarray | None
                      ) -> tuple[np.ndarray, Report]:
        """The same on the device where the samples or the image lie, and here where it fails."""
        try:
            return self._there._formed(number, block, onto)
        except DeviceError as error:
            _logger.warning(f'{error}; the processor computes')
        here = dataclasses.replace(block, samples=to_host(block.samples))
        samples, report = self._formed(number, here)
        samples = beside(samples, block.samples if onto is None else onto)
        return (samples if onto is None else np.add(onto, samples, out=onto)), report

    @functools.cached_property
    def _there(self) -> Imager:
        """The same imager on the device."""
        return Imager(self.grid, self.radar, self.n_samples, self._asked or AUTO,
                      dataclasses.replace(self._options, backend=CUDA), self._channels, self._own)

    def _planned(self, number: int, *where: Any) -> Method:
        """The method for some phase centres and directions; that of the latest ones is kept."""
        latest = self._latest.get(number)
        if latest is not None and latest.is_for(*where):
            return latest
        if self._asked is not None:
            return self._plan_anew(number, self._asked, where, 'asked for')
        exact = self._plan_anew(number, method_class(EXACT), where, '')
        quicker, reason = self._quicker(exact, where)
        chosen = self._latest[number] = quicker or exact
        chosen.report = dataclasses.replace(chosen.report, reason=reason)
        return chosen

    def _quicker(self, exact: Method, where: Sequence[Any]) -> tuple[Method | None, str]:
        """AFBP, where it meets the target in less time than exact backprojection, or why not."""
        seconds = exact.report.seconds
        if not isinstance(self.grid, MapGrid | PolarGrid):
            return None, 'AFBP images polar grids and flat maps alone'
        if seconds is None or seconds < _WORTH_PLANNING_S:
            return None, 'as quick as planning another'
        try:
            afbp = self._make(method_class(AFBP))
            tx_m, rx_m, pointing = where
            afbp.replan(tx_m, rx_m, '', pointing)
        except (ValueError, MemoryError) as error:
            return None, f'AFBP is not possible: {error}'
        if doubts := cast(Any, afbp.report.plan).subapertures.warnings:
            return None, f'AFBP may miss the target: {"; ".join(doubts)}'
        quicker = cast(float, afbp.report.seconds)
        if quicker + _PLANNING_S >= seconds:
            return None, f'AFBP would take {quicker:.2g} s, this {seconds:.2g} s'
        return afbp, (f'meets the target in {quicker:.2g} s, exact backprojection takes '
                      f'{seconds:.2g} s')

    def _plan_anew(self, number: int, method: type[Method], where: Sequence[Any], reason: str
                   ) -> Method:
        latest = self._latest.get(number)
        if latest is None or type(latest) is not method:
            latest = self._latest[number] = self._make(method)
        tx_m, rx_m, pointing = where
        try:
            latest.replan(tx_m, rx_m, reason, pointing)
        except BeyondPeriod:
            self._beyond_period = True
            self._latest.clear()
            return self._plan_anew(number, method, where, reason)
        return latest

    def _make(self, method: type[Method]) -> Method:
        radar, n_samples, options = self.radar, self.n_samples, self._options
        if not options.compressed and (self._beyond_period and method.NAME == EXACT
                                       or not method.takes_raw(radar)):
            radar, n_samples = self._compressor.output_radar, self._compressor.n_output
            options = dataclasses.replace(options, compressed=True, weighting='none')
        like = next((m for m in self._latest.values() if type(m) is method), None)
        return method(self.grid, radar, n_samples, options, self._own, like)

    @functools.cached_property
    def _compressor(self) -> RangeCompressor:
        from ..signal.range_compression import RangeCompressor

        return RangeCompressor(self.radar, self.n_samples, window=self._options.weighting)

    def _profiles(self, planned: Method, raw: PulseBlock) -> PulseBlock:
        """Range profiles of raw pulses, on the device where a device will image them."""
        if planned.uses_device:
            try:
                return compress(self._compressor, raw, CUDA)
            except DeviceError as error:
                if planned.options.backend == CUDA:
                    raise
                _logger.warning(f'{error}; the processor computes')
        return compress(self._compressor, raw, planned.options.backend)

    def _image(self, planned: Method, block: PulseBlock, onto: np.ndarray | None = None
               ) -> tuple[np.ndarray, Report]:
        """Image of a block by a method, which may want range profiles."""
        if planned.options.compressed and not self._options.compressed:
            raw, block = block, self._profiles(planned, block)
            if onto is None and on_device(block.samples):  # profiles went there, not the image
                onto = zeros_beside(self.grid.shape, raw.samples)
        image, report = planned.image(block, onto)
        if not image.size:
            return image, report
        told = flight_warnings(self._middle_m, block, self._options.illumination)
        return image, (dataclasses.replace(report, warnings=(*report.warnings, *told)) if told
                       else report)

    @functools.cached_property
    def _middle_m(self) -> np.ndarray:
        """(1, 3) position of the pixel in the middle of the grid, metres."""
        middle = self.grid.positions(*(np.array([n // 2]) for n in self.grid.shape))
        return middle.reshape(1, 3)

    @staticmethod
    def _check_memory(shape: tuple[int, ...]) -> None:
        check_memory(IMAGE_BYTES * math.prod(shape),
                     f'an image of {" x ".join(map(str, reversed(shape)))} pixels',
                     'choose a smaller grid or a larger pixel spacing')


def _worse(one: Report, other: Report, *, first: bool) -> Report:
    """The report of the larger predicted error, with the warnings of both."""
    if first:
        return other
    before, after = one.predicted_error_db, other.predicted_error_db
    worse = other if before is None or after is None or after >= before else one
    powers = [r.pulse_power for r in (one, other) if r.pulse_power is not None]
    return dataclasses.replace(
        worse, pulse_power=sum(powers) if powers else None,
        band_end_power=one.band_end_power + other.band_end_power,
        warnings=tuple(dict.fromkeys((*one.warnings, *other.warnings))))

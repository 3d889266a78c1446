"""Drawing of raw pulses: echoes over time, values of the samples, times, channels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from sar_imaging.diagnosis.signals import scatter_s
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.range_compression import RangeCompressor

_MOST_PULSES = 1024
_SHOWN_DB = 60.0
_LEAST_MS = 1e-3  # of the axis of times


def save_signal_png(path: Path | str, block: PulseBlock, *, title: str) -> None:
    """Draw what tells faults of a recording to the eye.

    Parameters
    ----------
    path : path
        PNG file to write.
    block : PulseBlock
        Pulses in the order sent.
    title : str
        Over the picture.
    """
    some = block.select(slice(None, None, -(-block.n_pulses // _MOST_PULSES)))
    compressor = RangeCompressor.for_block(some)
    profiles = compressor(some).samples
    radar = compressor.output_radar
    range_m = radar.range_start_m + np.arange(profiles.shape[2]) * radar.sample_spacing_m
    figure = Figure(figsize=(11.0, 7.2), layout='constrained')
    FigureCanvasAgg(figure)
    (echoes, values), (times, channels) = figure.subplots(2, 2)
    _echoes(figure, echoes, profiles[:, 0], range_m)
    _values(values, some)
    _times(times, block)
    _channels(channels, profiles, range_m)
    for axes in (values, times, channels):
        axes.grid(True, color='0.9', linewidth=0.6)
        axes.set_axisbelow(True)
    figure.suptitle(title, fontsize=11)
    figure.savefig(path, dpi=110)


def _level_db(power: np.ndarray) -> np.ndarray:
    return 10 * np.log10(np.maximum(power / max(float(power.max()), 1e-30), 1e-12))


def _echoes(figure, axes, profiles: np.ndarray, range_m: np.ndarray) -> None:
    shown = axes.imshow(_level_db(np.square(np.abs(profiles))), aspect='auto', cmap='viridis',
                        vmin=-_SHOWN_DB, vmax=0.0, interpolation='nearest',
                        extent=(range_m[0], range_m[-1], len(profiles), 0))
    axes.set(title='range profiles of channel 0', xlabel='range (m)', ylabel='pulse')
    figure.colorbar(shown, ax=axes, label='dB')


def _values(axes, block: PulseBlock) -> None:
    for name, part in (('I', block.samples.real), ('Q', block.samples.imag)):
        if part.any():
            axes.hist(part.ravel()[:2_000_000], bins=201, histtype='step', label=name)
    axes.set(title='values of the samples (piles at the ends: clipping)', xlabel='value',
             ylabel='samples', yscale='log')
    axes.legend(fontsize=8)


def _times(axes, block: PulseBlock) -> None:
    counter = block.counter.astype(np.int64)
    order = np.argsort(counter, kind='stable')
    counter = counter[order]
    seconds = (block.stamp_ns[order] - block.stamp_ns[order[0]]) * 1e-9
    if len(counter) > 32:
        late = scatter_s(counter, seconds)
        half = (len(counter) - len(late)) // 2
        axes.plot(counter[half:len(counter) - half], 1e3 * late, '.', ms=2)
        limit = max(1.2e3 * float(np.abs(late).max()), _LEAST_MS)
        axes.set_ylim(-limit, limit)
    axes.set(title='stamps less those of their neighbours', xlabel='number of the pulse',
             ylabel='ms')


def _channels(axes, profiles: np.ndarray, range_m: np.ndarray) -> None:
    power = np.mean(np.square(np.abs(profiles)), axis=0)
    level = _level_db(power)
    for number in range(min(len(level), 16)):
        axes.plot(range_m, level[number], lw=0.9, label=f'channel {number}')
    stays = np.square(np.abs(profiles[:, 0].mean(axis=0)))
    axes.plot(range_m, 10 * np.log10(np.maximum(stays / power.max(), 1e-12)), color='0.6', lw=0.8,
              label='stays, channel 0')
    axes.set(title='mean profiles', xlabel='range (m)', ylabel='dB',
             ylim=(max(float(level.min()), -_SHOWN_DB) - 15, 3))
    axes.legend(fontsize=7, ncols=2)

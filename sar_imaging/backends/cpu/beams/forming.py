"""Compiled loop that forms the beams of a sub-aperture from the spectra of its echoes.

Free of views for the compiler, see `line_kernels`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ....compilation import DETERMINISTIC, njit, numba
from ....planning.afbp.beam_gain import BeamGain
from ..line_kernels import _cos_cycles, _fraction, _sin_cycles
from ..threads import job_counter, take_job
from .accumulation import ECHOES, LANES, add_echoes
from .phasors import echo_phasors

BINS = 128  # whose samples stay in the cache
_GAUSS = 0.5 - 0.5 / 3 ** 0.5  # where a straight line agrees best with a parabola over 0 to 1
_E0, _E2, _E3, _E4, _E5 = (np.float32(1 / v) for v in (1, 2, 6, 24, 120))

_u = np.uint64


class SpectrumBins(NamedTuple):
    """Bins of the echoes' spectra that make beams.

    Parameters
    ----------
    runs : (J, 4) int64
        Bins of each job: the first one in the echoes' spectra and in the beams', its number
        counted from the carrier's, how many.
    common : (2 * N,) float32
        Factor of each bin of the echoes' spectra, real and imaginary parts in turn.
    cycles : (2,) float64
        Cycles per metre of half path at the carrier, and what they grow from bin to bin.
    n_cells : int
        Bins of the beams' spectra.
    """

    runs: np.ndarray
    common: np.ndarray
    cycles: np.ndarray
    n_cells: int

    @classmethod
    def of(cls, common, cycles, zero: int, n_cells: int, longest: int) -> SpectrumBins:
        """Runs of at most so many of the bins that cells hold; `zero` is the carrier's."""
        n_bins = len(common)
        kept = min(n_bins, n_cells)
        upper, lower = (kept + 1) // 2, kept // 2
        runs = []
        for first, target, start, count in ((zero, 0, 0, upper), ((zero - lower) % n_bins,
                                                                  n_cells - lower, -lower, lower)):
            runs += [(first + i, target + i, start + i, min(longest, count - i))
                     for i in range(0, count, longest)]
        return cls(np.array(runs), common.astype(np.complex64).view(np.float32), cycles, n_cells)


def form_beams(spectra, path_m, bins: SpectrumBins, between: BeamGain, weights, group: int,
               paired: bool, beams, buffer) -> None:
    """Sum of the echoes' spectra with the delays of each direction.

    That of `backends.reference.form_beams`, with a factor a of each bin and w of each echo. The
    gain is that of the middle of a group of beams, its logarithm a straight line over each run of
    bins. What lies between the bins of positive and those of negative number is set to zero.

    Parameters
    ----------
    spectra, path_m : (R, N) complex64, (M, R) float64
        S, contiguous, and L, metres.
    bins, between, weights : SpectrumBins, BeamGain, (R,) float32 or None
        a, c and which bins; g; w.
    group, paired : int, bool
        Beams of a group, see `phasors`: even, or one; echoes on opposite sides share phasors.
    beams : (M, at least n_cells) complex64
        Written to; contiguous.
    buffer : callable
        ``buffer(name, shape, dtype)`` gives work space.
    """
    n_beams, n_echoes = path_m.shape
    phasors = echo_phasors(path_m, group, paired, bins.cycles)
    n_tasks, half = numba.get_num_threads(), -(-group // 2)
    sizes = {'base re': BINS * len(phasors.order), 'base im': BINS * len(phasors.order),
             'turn re': len(phasors.middle) * LANES, 'turn im': len(phasors.middle) * LANES,
             'turn steps': 2 * len(phasors.middle), 'echoes': 4 * ECHOES * LANES,
             'phasor re': len(phasors.beside), 'phasor im': len(phasors.beside),
             'sums': 4 * half * BINS}
    work = tuple(buffer(name, (n_tasks * size,), np.float32) for name, size in sizes.items())
    jobs = job_counter()
    # plain tuples: Numba takes 20 us to tell the type of a named one
    _form_beams(spectra.reshape(-1).view(np.float32),
                (spectra.shape[1], n_beams, beams.shape[1]), tuple(bins),
                np.ones(n_echoes, np.float32) if weights is None else weights, tuple(phasors),
                (between.log_gain, between.step), group, beams.reshape(-1).view(np.float32),
                jobs.ctypes.data, work)


@njit(parallel=True, fastmath=DETERMINISTIC)
def _form_beams(samples, shape, bins, weight, phasors, gain, group, out, jobs, work):
    """Run by run of bins; `phasors` says how beams and echoes share phases.

    What a pair's cosines and sines count is summed apart: one beam is their sum, the other their
    difference. The growth of phases from bin to bin is held over a vector of bins. Complex arrays
    are flat, real and imaginary parts in turn; `shape` is bins, beams, and bins from one beam to
    the next. The middle one of an odd group is a pair's both.
    """
    runs, common, cycles_per_bin, n_cells = bins
    order, shift, carrier, slope, beside, turn_step, phasor_step = phasors
    log_gain, gain_step = gain
    base_re, base_im, turn_re, turn_im, turn_steps, echoes, phasor_re, phasor_im, sums = work
    n_bins, n_beams, n_out = shape
    kept = min(n_bins, n_cells)
    n_echoes, n_groups, half = len(order), (n_beams + group - 1) // group, (group + 1) // 2
    n_turns, n_phasors = n_groups * n_echoes * LANES, len(beside)
    n_blocks = n_phasors // (n_groups * half * ECHOES)
    per_block = n_echoes // n_blocks
    middle, n_tasks = 0.5 * (LANES - 1), len(echoes) // (ECHOES * 4 * LANES)
    for task in numba.prange(n_tasks):
        run = take_job(jobs)
        while run < len(runs):
            for m in range(run * n_beams // len(runs), (run + 1) * n_beams // len(runs)):
                for i in range(_u(2 * (m * n_out + (kept + 1) // 2)),
                               _u(2 * (m * n_out + n_cells - kept // 2))):
                    out[i] = 0.0
            first, target, number, left = runs[run, 0], runs[run, 1], runs[run, 2], runs[run, 3]
            base, turn, phasor = task * BINS * n_echoes, task * n_turns, task * n_phasors
            echo, total = task * ECHOES * 4 * LANES, task * 4 * half * BINS
            n_steps = n_groups * n_echoes
            steps = 2 * task * n_steps
            ends = (cycles_per_bin[0] + (number + _GAUSS * left) * cycles_per_bin[1],
                    cycles_per_bin[0] + (number + (1.0 - _GAUSS) * left) * cycles_per_bin[1])
            for k in range(n_steps):
                cycles = cycles_per_bin[1] * shift[k]
                start = _fraction(carrier[k] + number * cycles)
                grown = _read_table(log_gain, np.abs(slope[k] * ends[0]) / gain_step)
                rate = _read_table(log_gain, np.abs(slope[k] * ends[1]) / gain_step) - grown
                rate /= (1.0 - 2.0 * _GAUSS) * left
                first_gain = np.float32(np.exp(grown - _GAUSS * left * rate))
                to, x = _u(turn + k * LANES), np.float32(rate)
                for i in range(LANES):
                    c = np.float32(_fraction(start + i * cycles))
                    gain = first_gain * _exp(x * np.float32(i))
                    turn_re[to + _u(i)] = gain * _cos_cycles(c * c)
                    turn_im[to + _u(i)] = gain * _sin_cycles(c, c * c)
                gain = _exp(x * np.float32(LANES))
                turn_steps[_u(steps + k)] = gain * turn_step[_u(k)]
                turn_steps[_u(steps + n_steps + k)] = gain * turn_step[_u(n_steps + k)]
            per_metre = cycles_per_bin[0] + (number + middle) * cycles_per_bin[1]
            for k in range(_u(n_phasors)):
                c = np.float32(_fraction(per_metre * beside[k]))
                phasor_re[_u(phasor) + k] = _cos_cycles(c * c)
                phasor_im[_u(phasor) + k] = _sin_cycles(c, c * c)
            while left > 0:
                count = min(left, BINS)
                n_vectors = (count + LANES - 1) // LANES
                _load_echoes(samples, n_bins, first, count, common, weight, order, per_block,
                           base_re, base_im, base)
                for g in range(n_groups):
                    for i in range(_u(4 * half * BINS)):
                        sums[_u(total) + i] = 0.0
                    for b in range(g * n_blocks, (g + 1) * n_blocks):
                        source = base + (b - g * n_blocks) * per_block * BINS
                        for v in range(n_vectors):
                            _turn(base_re, base_im, source + v * per_block * LANES, turn_re,
                                  turn_im, turn + b * per_block * LANES, turn_steps,
                                  steps + b * per_block, n_steps, per_block, echoes, echo)
                            add_echoes(echoes, _u(echo), phasor_re, phasor_im,
                                       _u(phasor + b * half * ECHOES), _u(half), sums,
                                       _u(total + 4 * v * half * LANES))
                            now, step = _u(phasor + b * half * ECHOES), _u(b * half * ECHOES)
                            for i in range(_u(half * ECHOES)):
                                cosine, sine = phasor_re[now + i], phasor_im[now + i]
                                re = phasor_step[step + i]
                                im = phasor_step[_u(n_phasors) + step + i]
                                phasor_re[now + i] = cosine * re - sine * im
                                phasor_im[now + i] = cosine * im + sine * re
                    n_some = min(group, n_beams - g * group)
                    for m in range(n_some):
                        source = total + 4 * min(m, n_some - 1 - m) * LANES
                        side = np.float32(1.0 if 2 * m < n_some else -1.0)
                        to = 2 * ((g * group + m) * n_out + target)
                        _put_beam(sums, source, half, count, side, out, to)
                first, target, left = first + count, target + count, left - count
                number += count
            run = take_job(jobs)


@njit(inline='always')
def _read_table(table, place):
    i = min(np.int64(place), len(table) - 2)
    return table[i] + min(place - i, 1.0) * (table[i + 1] - table[i])


@njit(inline='always')
def _exp(x):
    """Of what a gain grows over a vector of bins, which is little."""
    return _E0 + x * (_E0 + x * (_E2 + x * (_E3 + x * (_E4 + x * _E5))))


@njit(inline='always')
def _load_echoes(samples, n_bins, first, count, common, weights, order, per_block, base_re,
               base_im, base):
    """Some bins of all echoes times their factors, vector by vector, zero beyond the last."""
    whole = count // LANES
    for place in range(len(order)):
        echo = order[place]
        begin = base + place // per_block * per_block * BINS + place % per_block * LANES
        if echo < 0:
            for v in range((count + LANES - 1) // LANES):
                to = _u(begin + v * per_block * LANES)
                for lane in range(LANES):
                    base_re[to + _u(lane)] = 0.0
                    base_im[to + _u(lane)] = 0.0
            continue
        weight = weights[echo]
        source, factor = _u(2 * (echo * n_bins + first)), _u(2 * first)
        for v in range(whole):
            to = _u(begin + v * per_block * LANES)
            for lane in range(LANES):
                i = _u(lane)
                re, im = samples[source + _u(2) * i], samples[source + _u(2) * i + _u(1)]
                cosine = weight * common[factor + _u(2) * i]
                sine = weight * common[factor + _u(2) * i + _u(1)]
                base_re[to + i] = re * cosine - im * sine
                base_im[to + i] = re * sine + im * cosine
            source += _u(2 * LANES)
            factor += _u(2 * LANES)
        for lane in range((count > whole * LANES) * LANES):
            to = _u(begin + whole * per_block * LANES + lane)
            base_re[to] = 0.0
            base_im[to] = 0.0
            if lane < count - whole * LANES:
                i = _u(2 * lane)
                re, im = samples[source + i], samples[source + i + _u(1)]
                cosine, sine = weight * common[factor + i], weight * common[factor + i + _u(1)]
                base_re[to] = re * cosine - im * sine
                base_im[to] = re * sine + im * cosine


@njit(inline='always')
def _turned(base_re, base_im, source, turn_re, turn_im, now, cosine_step, sine_step):
    """Sample times its phasor, which moves on by a vector."""
    cosine, sine = turn_re[now], turn_im[now]
    x, y = base_re[source], base_im[source]
    turn_re[now] = cosine * cosine_step - sine * sine_step
    turn_im[now] = cosine * sine_step + sine * cosine_step
    return x * cosine - y * sine, x * sine + y * cosine


@njit(inline='always')
def _turn(base_re, base_im, base, turn_re, turn_im, turn, step, first, n_steps, n_echoes, echoes,
          echo):
    """A block of echoes from the group's middle: what a phasor's real and imaginary part count.

    An echo's phasor multiplies its samples and j times them; where echoes share one, their sum and
    j times their difference.
    """
    for k in range(ECHOES):
        source, now, to = _u(base + k * LANES), _u(turn + k * LANES), _u(echo + 4 * k * LANES)
        cosine, sine = step[_u(first + k)], step[_u(n_steps + first + k)]
        if n_echoes == ECHOES:
            for lane in range(LANES):
                i = _u(lane)
                re, im = _turned(base_re, base_im, source + i, turn_re, turn_im, now + i, cosine,
                                 sine)
                echoes[to + i], echoes[to + _u(LANES) + i] = re, im
                echoes[to + _u(2 * LANES) + i], echoes[to + _u(3 * LANES) + i] = -im, re
        else:
            other, then = source + _u(ECHOES * LANES), now + _u(ECHOES * LANES)
            c, s = step[_u(first + ECHOES + k)], step[_u(n_steps + first + ECHOES + k)]
            for lane in range(LANES):
                i = _u(lane)
                re, im = _turned(base_re, base_im, source + i, turn_re, turn_im, now + i, cosine,
                                 sine)
                x, y = _turned(base_re, base_im, other + i, turn_re, turn_im, then + i, c, s)
                echoes[to + i], echoes[to + _u(LANES) + i] = re + x, im + y
                echoes[to + _u(2 * LANES) + i], echoes[to + _u(3 * LANES) + i] = y - im, re - x


@njit(inline='always')
def _put_beam(sums, first, half, count, side, out, target):
    """Write some bins of the beam on one side of the group's middle."""
    for v in range((count + LANES - 1) // LANES):
        re, to = _u(first + 4 * v * half * LANES), _u(target + 2 * v * LANES)
        im, odd = re + _u(LANES), _u(2 * LANES)
        for i in range(_u(min(LANES, count - v * LANES))):
            out[to + _u(2) * i] = sums[re + i] + side * sums[re + odd + i]
            out[to + _u(2) * i + _u(1)] = sums[im + i] + side * sums[im + odd + i]

"""Print the results of `evaluate`: scatterers, counts, focus, explained abbreviations."""

from __future__ import annotations

from . import examination

_COLUMNS = (('IRW (m)', 'irw', 'm', 3), ('PSLR (dB)', 'pslr', 'db', 2),
            ('ISLR (dB)', 'islr', 'db', 2), ('error (m)', 'position_error', 'm', 3))
_LEGEND = """\
Every column has two figures, along range (away from the radar) and along azimuth (across that).
IRW: impulse response width, of a point at half of its power. PSLR: peak sidelobe ratio, the
highest sidelobe over the peak. ISLR: integrated sidelobe ratio, the energy of all sidelobes over
that of the main lobe. error: measured minus true position. -: could not be measured, see below
its line or in quality.json. docs/evaluate.md explains how they are measured."""


def summary(quality: dict) -> str:
    """Readable text of what quality.json holds."""
    lines = []
    if quality['scatterers']:
        width = max(len('range, azimuth'), *(len(s['name']) for s in quality['scatterers']))
        lines.append('  '.join([f'{"range, azimuth":{width}}',
                                *(f'{title:>15}' for title, *_ in _COLUMNS)]))
    for s in quality['scatterers']:
        pairs = [', '.join(_number(s[f'{key}_{axis}_{unit}'], n) for axis in ('range', 'azimuth'))
                 for _, key, unit, n in _COLUMNS]
        lines.append('  '.join([f'{s["name"]:{width}}', *(f'{p:>15}' for p in pairs)]))
        if s['reason']:
            lines.append(f'{"":{width}}    {s["reason"]}')
    if quality['scatterers']:
        lines.append(_LEGEND)
    unplaced = quality['nodes'].get('pulse_buffer', {}).get('pulses_without_pose')
    if unplaced:
        lines.append(f'warning: {unplaced} pulses had no pose in time and are not in the image')
    lines.append(f'pulses received {quality["pulses_received"]}, missing '
                 f'{quality["pulses_missing"]}; blocks rejected {quality["blocks_rejected"]}; '
                 f'last pulse to image {quality["seconds_last_pulse_to_image"]:.2f} s; predicted '
                 f'error {_number(quality["predicted_error_db"], 0)} dB against exact correlation')
    lines.append(examination.describe(quality['focus']))
    if found := quality['autofocus']:
        lines.append(f'autofocus: {found["verdict"]}; clock offset found '
                     f'{_number(found["time_offset_s"], 4)} s, largest correction of a position '
                     f'{_number(found["largest_move_m"], 3)} m, contrast '
                     f'{_number(found["contrast_before"], 2)} to '
                     f'{_number(found["contrast_after"], 2)}; {found["reason"]}')
    return '\n'.join(lines)


def _number(value: float | None, digits: int) -> str:
    return '-' if value is None else f'{value:.{digits}f}'

# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Which names are public: those of the API reference, each with an example that runs.

A name is public if a package lists it in `__all__`, or if it is among `MODULES` below: names that
users import from the module itself, since its package loads nothing beforehand. Everything else
may change without notice. `docs/conf.py` and `test/test_examples.py` read this file.
"""

from __future__ import annotations

import importlib
import inspect
import pathlib

ROOT = pathlib.Path(__file__).resolve().parent.parent

# Packages that list names for their neighbours, not for users, and why.
INTERNAL = {
    'sar_imaging.nodes': 'programs: users meet their topics and parameters, see docs/nodes',
}

# Names that pages import from modules, or from packages whose other names are internal.
MODULES = {
    'msg_conversions.images': (
        'amplitude_from_message', 'amplitude_to_message', 'complex_from_message',
        'complex_to_message', 'map_metadata_from_message', 'map_metadata_to_message',
        'occupancy_from_message', 'occupancy_to_message', 'quicklook_to_message'),
    'msg_conversions.navigation': (
        'attitude_from_message', 'datum_from_message', 'datum_to_message', 'fix_from_message'),
    'msg_conversions.planar_poses': ('pose_to_message', 'transform_to_message'),
    'msg_conversions.point_cloud': ('from_message', 'to_message'),
    'msg_conversions.pulse_block': ('from_bare_cube', 'from_message', 'to_message'),
    'msg_conversions.subaperture_image': ('from_message', 'to_message'),
    'sar_imaging.autofocus.corrected_track': ('CorrectedTrack', 'corrected_track'),
    'sar_imaging.autofocus.live': ('live_autofocus',),
    'sar_imaging.autofocus.phase_gradient': ('PhaseGradient',),
    'sar_imaging.autofocus.tiles': ('Tiles', 'bright_points'),
    'sar_imaging.autofocus.track': ('PhaseCentreTrack', 'on_track'),
    'sar_imaging.backends.checks': ('check_backend',),
    'sar_imaging.backends.reference.project_points': ('half_paths',),
    'sar_imaging.backends.reference.resample_profiles': ('profile_spectra',),
    'sar_imaging.backends.samples': ('compress', 'to_device'),
    'sar_imaging.configuration.parameters': ('default_file', 'read_configuration'),
    'sar_imaging.diagnosis.signals': (
        'CERTAIN', 'LIKELY', 'ONE_OF_SEVERAL', 'Finding', 'channel_findings', 'coupling_findings',
        'sample_findings', 'slope_findings', 'timing_findings'),
    'sar_imaging.exploitation.localization': (
        'Estimate', 'Guess', 'Localizer', 'OdometryTrack', 'Refusal'),
    'sar_imaging.exploitation.registration': (
        'Candidate', 'LookDirection', 'Registration', 'Speckle', 'measured_resolution_m',
        'register'),
    'sar_imaging.formats.pose_graph': ('PoseEdge', 'read_g2o', 'write_g2o'),
    'sar_imaging.formats.reference_map': (
        'Pass', 'ReferenceMap', 'read_reference_map', 'write_reference_map'),
    'sar_imaging.geometry.alignment': ('Alignment',),
    'sar_imaging.geometry.antenna': ('Antenna', 'Mount'),
    'sar_imaging.geometry.illumination': (
        'NO_SPREAD', 'AmplitudeSpread', 'AntennaPattern', 'Illumination', 'PatternCut',
        'Pointing'),
    'sar_imaging.geometry.navigation': (
        'DatumSearch', 'Fix', 'FixPoses', 'FoundDatum', 'FramePose', 'datum_through'),
    'sar_imaging.geometry.poses': ('PoseTrack',),
    'sar_imaging.geometry.terrain': ('Terrain',),
    'sar_imaging.imaging.checks': ('check_method',),
    'sar_imaging.imaging.correlation': ('correlate', 'correlate_profiles'),
    'sar_imaging.imaging.image': ('Report',),
    'sar_imaging.imaging.methods': ('Method',),
    'sar_imaging.imaging.radiometry': ('Radiometry',),
    'sar_imaging.planning.profiles': ('RangeGate',),
    'sar_imaging.quality.verification': ('Verification', 'measure_error'),
    'sar_imaging.signal.background': ('BackgroundFilter',),
    'sar_imaging.signal.calibration': ('CalibrationError', 'ChannelCalibration'),
    'sar_imaging.signal.dechirp': ('fmcw_parameters',),
    'sar_imaging.signal.positioning': ('locate',),
    'sar_imaging.signal.pulses.buffer': ('PulseBuffer',),
    'sar_imaging.signal.range_compression': ('RANGE_FILTERS', 'RangeCompressor'),
    'sar_imaging.signal.spectra': ('band_spectrum',),
    'sar_imaging.signal.windows': ('parse_window', 'window'),
    'sar_imaging.simulation.survey': ('Survey',),
    'sar_imaging.streaming.aperture': ('ApertureImager',),
    'sar_imaging.streaming.fusion': ('LiveFusion',),
    'sar_imaging.streaming.mosaic': ('StripMosaic',),
    'sar_imaging.streaming.subapertures': ('LiveSubapertures',),
    'sar_imaging.tools.plots': ('save_image_png',),
    'sar_imaging.tools.simulate_archive': ('write_archive',),
}


def _is_internal(package: str) -> bool:
    return any(f'{package}.'.startswith(f'{internal}.') for internal in INTERNAL)


def _packages() -> list[str]:
    files = [path for top in ('sar_imaging', 'msg_conversions')
             for path in sorted((ROOT / top).rglob('__init__.py'))]
    return ['.'.join(path.parent.relative_to(ROOT).parts) for path in files]


def public_names() -> dict[str, tuple[str, ...]]:
    """Public names of each package and module, by the name of this.

    A name that several packages list counts for each of them.
    """
    names = {}
    for package in _packages():
        if not _is_internal(package):
            if listed := getattr(importlib.import_module(package), '__all__', ()):
                names[package] = tuple(listed)
    for module, listed in MODULES.items():
        names[module] = (*names.get(module, ()), *listed)
    return names


def pages() -> dict[str, dict[str, str]]:
    """Full names under which the reference describes the names of each package.

    A name that several packages list is described with the one of them that is highest up.
    """
    names, homes = public_names(), {}
    for package, listed in names.items():
        for name in listed:
            value = getattr(importlib.import_module(package), name)
            same = [other for other, others in names.items() if name in others
                    and getattr(importlib.import_module(other), name) is value]
            home = min(same, key=lambda other: (other.count('.'), other))
            homes.setdefault(package, {})[name] = f'{home}.{name}'
    return homes


def public_objects() -> dict[str, object]:
    """Public classes and functions by the module and name that define them, each once.

    Constants are left out: their module's page tells their values.
    """
    objects = {}
    for module, names in public_names().items():
        for name in names:
            value = getattr(importlib.import_module(module), name)
            if inspect.isclass(value) or inspect.isfunction(value):
                objects[f'{value.__module__}.{value.__qualname__}'] = value
    return dict(sorted(objects.items()))

# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""
Moving targets with several channels
====================================

A car that drives while it is imaged appears beside its road: its range rate looks like another
direction. Several receive channels along the flight see the same place one after the other. What
stands still is the same in their images and cancels; what moves stays, and its phase from channel
to channel tells how fast.
"""

import matplotlib.pyplot as plt
import numpy as np

from sar_imaging import concatenate, plan_image
from sar_imaging.exploitation.movers.moving_targets import MovingTargetFinder
from sar_imaging.simulation import SCENARIOS

# %%
# Three cars drive over rough ground. Each is fainter than the ground of its resolution cell.

scenario = SCENARIOS['moving_targets']()
profiles = concatenate(list(scenario.blocks())).select(slice(0, scenario.pulses_per_aperture))
image = plan_image(scenario.grid, profiles.radar, profiles.n_samples)(profiles)
found = MovingTargetFinder(scenario.grid, false_alarm_rate=1e-6)(profiles)
for d in found['detections']:
    print(f'({d.position_m[0]:5.1f}, {d.position_m[1]:5.1f}) m, '
          f'{d.radial_velocity_m_per_s:+.1f} ± {d.radial_velocity_std_m_per_s:.1f} m/s, '
          f'{d.snr_db:.0f} dB')

# %%
# The crosses are where the cars appear, the arrows lead to where they are, by the range rate that
# was measured. The circles are the true places in the middle of these pulses. The range rate is
# known to half a metre a second, the place along the flight to some metres.

grid = scenario.grid
extent = (grid.x_m[0], grid.x_m[-1], grid.y_m[-1], grid.y_m[0])
middle_s = (scenario.pulses_per_aperture - scenario.n_pulses) / 2 / scenario.prf_hz
figure, axes = plt.subplots(figsize=(6.4, 5.6), layout='constrained')
axes.imshow(20 * np.log10(np.abs(image)), extent=extent, vmin=10, cmap='gray')
for mover in scenario.movers:
    x, y, _ = np.add(mover.position_m, np.multiply(middle_s, mover.velocity_m_per_s))
    axes.plot(x, y, 'o', mfc='none', mec='#4cc9f0', ms=14, mew=2)
for d in found['detections']:
    axes.plot(*d.apparent_m[:2], 'x', color='#ffb454', ms=9, mew=2)
    axes.annotate('', d.position_m[:2], d.apparent_m[:2],
                  arrowprops={'arrowstyle': '->', 'color': '#ffb454', 'lw': 1.6})
axes.set(title='Three cars: where they appear and where they are', xlabel='x (m)', ylabel='y (m)')

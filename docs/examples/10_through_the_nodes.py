# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""
A recording through the ROS 2 nodes
===================================

The nodes compute what the arrays of the other examples compute. This example writes a recording as
a radar driver would leave it, starts ``pulse_buffer``, ``range_compression`` and
``backprojection`` as processes, replays the recording over DDS, and compares the image that the
nodes publish with the true places of the reflectors.

Needs a ROS 2 installation, or its wheels as :doc:`/install` shows.
"""

import json
import pathlib
import subprocess
import sys
import tempfile

import matplotlib.image
import matplotlib.pyplot as plt

folder = pathlib.Path(tempfile.mkdtemp())


def run(module, *words):
    """Run a program of the package in the folder; returns what it says."""
    return subprocess.run([sys.executable, '-m', f'sar_imaging.tools.{module}', *words],
                          cwd=folder, capture_output=True, text=True, check=True).stdout


# %%
# ``ros2 bag play`` replays this recording, too.

print(run('simulate', 'spotlight', '--output', 'flight'))

# %%
# The images come back as ``sensor_msgs/Image``; nothing is read from the nodes but their topics.

print(run('evaluate', 'flight', '--output', 'seen', '--launch-nodes'))
quality = json.loads((folder / 'seen' / 'quality.json').read_text())
print(f"{quality['seconds_last_pulse_to_image']:.1f} s from the last pulse to the image")

# %%
# ``evaluate`` leaves the picture, the complex image and every figure of quality in its folder.

figure, axes = plt.subplots(figsize=(7, 6), layout='tight')
axes.imshow(matplotlib.image.imread(folder / 'seen' / 'image.png'))
axes.axis('off')

# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Command-line programs: simulate, evaluate, calibrate, check a configuration, load recordings.

`command` is the one program `sar-imaging`, of which the others are commands. What they share:

- `program`, `arguments`: how commands begin and end, and arguments that several have;
- `evaluation`: a recording replayed through node processes, and its image measured;
- `costs`: what the operations of the compiled backend cost on this machine;
- `launching`, `node_processes`: nodes started by launch files and by programs.
"""

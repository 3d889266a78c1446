# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Common parts of all nodes: parameters, life cycle, worker thread, overload, diagnostics.

A node is a `stage.Stage`. It receives messages (`inlet`) and passes them to the worker thread
(`worker`, `overload`), in which one `step.Step` or several in a chain process them. `health`
reports, `managed` is the life cycle, `parameters` the tables of parameters.
"""

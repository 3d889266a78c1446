# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Hostile and damaged files of every kind that the package reads, made of small valid ones.

`readers.READERS` lists the valid files with the commands that read them, `readers.kinds_of` the
ways in which one is damaged: those of `any_file`, and those of its format, one module each. What
a file could execute or read writes or tells a canary, which must stay silent.
"""

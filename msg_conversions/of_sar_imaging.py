# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Mark this package as that of sar_imaging, see `sar_imaging.companion`."""

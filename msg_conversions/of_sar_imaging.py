"""Tells this package from others of its name: see `sar_imaging.companion`."""

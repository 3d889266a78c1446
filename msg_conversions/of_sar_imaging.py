"""Mark this package as that of sar_imaging, see `sar_imaging.companion`."""

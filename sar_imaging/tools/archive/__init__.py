"""The command `archive`, and former places of `sar_imaging.archive`, until the next release."""

"""Files of pulses to images, maps and comparisons that other programs read, one command each."""

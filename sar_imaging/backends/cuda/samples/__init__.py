"""What becomes of samples on a device before they are imaged.

- `compression`: the way there, and range compression.
"""

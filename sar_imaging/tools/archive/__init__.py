"""Archives of many recordings: images, strips, mosaics and coherence, divided among workers.

- `jobs`: what is to be made, and how the work is divided.
"""

"""Archives of many recordings: images, strips, mosaics and coherence, divided among workers.

- `jobs`: what is to be made, and how the work is divided.
- `products`: what pieces compute on a worker, and what they write.
"""

"""Costs of the operations of imaging on this machine: of its processor, or of a CUDA device.

- `scenes`: what the images are of;
- `experiments`: small images, with how often they do each operation;
- `measurement`: their times, and the costs that explain them.
"""

"""Costs of the operations of the compiled backend on this machine.

- `experiments`: small images, with how often they do each operation;
- `measurement`: their times, and the costs that explain them.
"""

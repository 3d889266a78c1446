"""Image formation: time-domain correlation and backprojection."""

import importlib.util

# The one dependency that a ROS machine may lack: not every apt repository has a recent one.
if importlib.util.find_spec('numba') is None:
    raise ModuleNotFoundError(
        'imaging needs Numba: install it with `apt install python3-numba`, or in a virtual '
        'environment as docs/install.md shows', name='numba')

"""ROS 2 nodes: parameters, quality of service, a worker thread, diagnostics; no mathematics."""

import os

# Threads of a kernel that wait for the next one would spin otherwise: half of the processor time
# of short kernels, which the other nodes and the middleware need. Read when the first one runs.
os.environ.setdefault('OMP_WAIT_POLICY', 'passive')

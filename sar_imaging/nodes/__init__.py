"""ROS 2 nodes: parameters, quality of service, a worker thread, diagnostics; no mathematics."""

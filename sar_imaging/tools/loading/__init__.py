"""Turn measured data into recordings: the command `load`, ROS bags, and clocks from images."""

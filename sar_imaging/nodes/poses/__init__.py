"""Positions in the nodes: poses from odometry, poses or tf, and lever arms.

`pose_input` brings poses into the worker's thread, `tf_input` reads tf, and `known_positions`
keeps where the phase centres were around an aperture.
"""

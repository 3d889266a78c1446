"""Common parts of the nodes that form images: grid, terrain, autofocus, focus and topics.

`image_grid` and `terrain` are where images lie, `autofocus` and `focus_watch` look after their
focus, `image_products` and `obstacle_products` publish what is made of them.
"""

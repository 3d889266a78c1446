"""What the nodes that form images share: the grid, the terrain, the focus, and the topics.

`image_grid` and `terrain` are where images lie, `autofocus` and `focus_watch` look after their
focus, `image_products` and `obstacle_products` publish what is made of them.
"""

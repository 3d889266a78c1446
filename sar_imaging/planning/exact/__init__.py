"""Plans of exact backprojection: the quickest way that meets the error asked for.

`backprojection` chooses among the lines of a grid (`grid_lines`), a polar image that is then
interpolated to the map (`polar_image`, `azimuth_upsampling`), and single points (`points`).
"""

"""Closed curves and the quantities measured on them.

text_rows, outline_files, outline_fit, outlines     from the points of a file to a smooth closed curve; no JAX
frame_files, frame_modes, frame_measures, frames    outlines at several times, with their noise
placement                               places for many vesicles in a cell; no JAX
shapes      circles, ellipses, curves through points
curve       `Curve`: nodes with tangent, normal, curvature; area, length, inclination angle
domain                                  the space that vesicles are in: the plane, or a periodic cell
starts      checks of starting curves
distance    distances of points from a curve
extremes    maxima and minima on a curve, also between its nodes; least distances
"""

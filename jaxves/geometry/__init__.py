"""Closed curves: where they come from, what they measure.

outline_files, outline_fit, outlines    points of a file to a smooth closed curve; no JAX
shapes      circles, ellipses, curves through points
curve       `Curve`: nodes with tangent, normal, curvature; area, length, inclination
starts      what a starting curve must fulfil
extremes    the greatest and least values of a function on a curve, between its nodes
"""

"""The layer potentials between all membranes of a scene.

interactions    interfaces for interactions between membranes, and loops over pairs
pairs           interactions as matrices of all pairs
near_pairs      search for close pairs
sums            interactions as sums, without matrices
surfaces        all membranes of a scene with their layer potentials
"""

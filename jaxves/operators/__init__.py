"""The layer potentials between all membranes of a scene.

interactions    interfaces for interactions between membranes, and loops over pairs
pairs           interactions as matrices of all pairs
near_pairs      search for close pairs
direct_sums     interactions as direct sums, without matrices
fast_sums       interactions as fast sums
sums            which of them, without matrices of all pairs
memory          how much memory a step takes, before it is computed
double_layers   the Stokes double layer between membranes, as direct sums
fast_double_layers   the same as fast sums, in the plane and in periodic cells
surfaces        all membranes of a scene with their layer potentials
"""

"""Which potentials act between which curves.

interactions    what vesicles do to one another: abstract operators, and loops over pairs
pairs           interactions as matrices of all pairs
near_pairs      the pairs that are close
sums            interactions without matrices
surfaces        all curves of a scene with the operators that act on them
"""

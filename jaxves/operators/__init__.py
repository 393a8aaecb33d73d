"""Which potentials act between which curves.

interactions    what vesicles do to one another; all pairs as matrices
near_pairs      the pairs that are close
sums            interactions without matrices
surfaces        all curves of a scene with the operators that act on them
"""

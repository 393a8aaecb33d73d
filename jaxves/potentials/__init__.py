"""Layer potentials of one curve: on it, close to it, far from it.

kernels                             free-space kernels of the Laplace and the Stokes equation
chords                              differences of nodes, with their limits on the diagonal
self_laplace, self_stokes           Nyström matrices of a curve on itself
self_refined                        the same where parts of one curve come close to one another
cauchy, close_laplace, close_stokes points arbitrarily close to a curve
far                                 the trapezoidal rule, for points far away
"""

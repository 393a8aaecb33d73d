"""Layer potentials of one curve: on the curve, close to it, and far from it. `slp`: single layer, `dlp`: double layer.

kernels                             free-space kernels of the Laplace and Stokes equations
chords                              differences of nodes, and the limits of kernels on the diagonal
self_laplace, self_stokes           Nyström matrices for targets on the same curve (self-interaction)
self_stokes_dlp                     the same for the Stokes double layer
self_refined                        self-interaction of a curve with a neck or a fold
cauchy, close_laplace, close_stokes targets at any distance from the curve (close evaluation)
far                                 targets far from the curve, by the trapezoidal rule
"""

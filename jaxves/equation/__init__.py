"""The differential equation dy/dt = F(t, y), and its linear part for implicit steps.

state           the unknowns, and what is known about one instant
inextensible    the tension that keeps the membrane from stretching
linear_part     what implicit steps take of F
implicit        the linear systems of implicit steps
symmetry        the symmetry of a scene, kept exactly
equation        F itself
norms           how large errors and changes are; whether a step may be gone on from
tracking        inclinations followed without jumps of π
"""

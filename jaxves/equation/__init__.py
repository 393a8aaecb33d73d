"""The differential equation dy/dt = F(t, y), and its linear part for implicit steps.

state           the unknowns, and all quantities at one instant
electrics       charging of the membranes and electric force
staged_charging charging that is solved within the stages of a step: charge relaxation
averaged_charging   the same for the envelope of an AC field; the choice of the model
normal_field    the integral equation for the normal field of all membranes
charging_of_shape  how charging changes when a membrane moves, for the linear part
mobility        velocities from forces
contrast        the same with two viscosities
inextensible    the tension that keeps the membrane from stretching
coupled         linear systems that couple all membranes
shape_block     the linear part A for the shape of one membrane
rotating_block  the same on N + 2 unknowns, for many nodes
linear_part     the linear part A for the shapes of all membranes, as one matrix
implicit        the linear part A at one instant, and solving with 1 - c A
projection      filter and projection after each step
symmetry        symmetries of a single vesicle, which are kept exactly
equation        F, A and the constraints
cells           the plane or the cell of a scene, and the coupling in it
norms           sizes of errors and changes, and checks of each step
tracking        inclinations without jumps of π
"""

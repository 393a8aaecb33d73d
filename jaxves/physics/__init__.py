"""The physical model: membrane, electric field, imposed flow, and units.

membrane    bending and tension forces, bending energy
electric    charging of the membrane, electric field on its two sides, Maxwell stress
charging    laws of charging, solved for one implicit stage
flow        imposed flows
point_functions  functions of one point that users write for flows and fields
waveform    the time dependence of the field
rigid       motion of a circle, which cannot deform
scene       `Scene`: starting nodes and all physical parameters
units       from SI units to the dimensionless numbers, and back
regime      estimates for a laboratory vesicle, and the limits of the model
"""

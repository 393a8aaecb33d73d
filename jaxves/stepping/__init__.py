"""Time stepping.

split_equation  what a scheme needs of an equation
schemes     additive Runge-Kutta schemes: one step
controller  step-size control: a PI controller
estimates   the sum of the estimated errors of all steps in a field or flow with a period
periods     the deformation over the last whole period of an AC field
state       the state between two steps, averages, and recorded steps
march       the interface of fixed and adaptive stepping
fixed       steps of equal length
adaptive    steps chosen from their embedded error
loop        the loop over saved times
replay      derivatives of recorded steps
record      `advance`: the loop, with its derivative
marching    `simulate`: from a scene to a result
"""

"""Many steps of a differential equation.

schemes     additive Runge-Kutta schemes: one step
controller  how long the next step is
state       the state between two steps, and what is kept beside it
march       the interface of what chooses steps
fixed       steps of equal length
adaptive    steps chosen from their embedded error
loop        the loop over saved instants
replay      recorded steps once more, for derivatives
record      `advance`: the loop with the derivative of its steps
marching    `simulate`: from a scene to saved instants
"""

"""Many steps of a differential equation.

schemes     additive Runge-Kutta schemes
control     how long the next step is; the loop over steps
replay      steps once more from their record, for derivatives
marching    `simulate`: from a scene to saved instants
"""

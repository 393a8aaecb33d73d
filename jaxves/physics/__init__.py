"""The model: what a membrane, a field and a flow are.

membrane    bending forces and the energy
electric    surface potentials, charging of the membrane, Maxwell stress
flow        flows from far away
waveform    how a field changes with time
circle      what a circle does, which has no shape to change
scene       `Scene`: everything that a run needs to know
units       volts, metres and seconds to the model's numbers and back
regime      which regime an experiment is in
"""

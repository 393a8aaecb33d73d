"""Runs: from a scene file to a result file.

build           builds a scene from the tables of a scene file
strength        how strong field and flow are, and which steps strong ones need
case            a scene file as a function of its numbers: scene, equation, time stepping, result
rest            relaxes vesicles before a run
problem         everything that time stepping needs, for one number of nodes
adapt_nodes     adapts the number of nodes during a run
error_estimate  estimates the error of a whole run with a second run
first_nodes     the nodes with which a run begins, as many as wrinkles need
earlier         starts a run from the result of another
continuation    decides whether a result file can be continued
rows            a buffer of rows that are written to the result file
beginning       begins a run: a new one, one from an earlier result, or a continued one
advice          what the nodes did not resolve, and what to change
runner          `run`
"""

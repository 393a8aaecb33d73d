"""From a scene file to a result file.

build           the tables of a scene file to a scene
case            a scene file with the numbers that are free: scene, equation, march, result
rest            vesicles relaxed before a run
problem         what a run computes, with its number of nodes
adapt_nodes     more nodes when they are needed
error_estimate  the error of a whole run, from a coarser one
earlier         a run that starts from another
continuation    a run that goes on from its own file
rows            rows on their way into the result file
beginning       how a run begins: new, from an earlier one, or at the end of its own file
runner          `run`
"""

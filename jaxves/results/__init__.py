"""Result files. Nothing in this folder imports JAX.

hdf5            functions for all files: opening, safe replacement, axes and labels
ownership       locks, so that each file has one writer
run_store       reads the file of a run
run_writer      writes the file of a run
restart         the restart state of a run
sweep_store     reads the file of a sweep
sweep_writer    writes the file of a sweep
loading         reads a result file of either kind
views           what results of runs have in common: a card, figures, tables
saving          writes a result of Python like the file of a run
labelled        results as datasets of xarray
exports         tables in CSV, and files for ParaView
"""

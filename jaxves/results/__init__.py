"""Result files. Nothing in this folder imports JAX.

hdf5            functions for all files: opening, safe replacement, axes and labels
ownership       locks, so that each file has one writer
run_store       reads the file of a run
run_writer      writes the file of a run
restart         the restart state of a run
sweep_store     reads the file of a sweep
sweep_writer    writes the file of a sweep
"""

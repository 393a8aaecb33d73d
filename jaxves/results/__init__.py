"""Result files. Nothing in this folder imports JAX.

hdf5            common pieces: opening, writing without loss, scales of axes
ownership       one process, one file
run_store       reading the file of a run
run_writer      writing it
restart         what a run needs to continue
sweep_store     reading the file of a sweep
sweep_writer    writing it
"""

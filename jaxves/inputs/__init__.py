"""Scene files and sweep files as checked tables. Nothing in this folder imports JAX.

checking, key_types             how tables are checked, and how complaints are worded
vesicle_tables, scene_tables    the keys of a scene file
scene_files                     reads and writes scene files, built-in ones too
parameters                      the physical numbers of a scene file by name
uses                            which use of a scene file honours which keys
sweep_tables, sweep_files       the same for sweeps
template                        the scene file that `jaxves init` writes
scenes                          the built-in scenes
"""

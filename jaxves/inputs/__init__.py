"""Scene files and sweep files as checked tables. Nothing in this folder imports JAX.

checking, key_types             checks of tables and types of keys, with their error messages
vesicle_tables, scene_tables    the keys of a scene file
cell_tables                     periodic cells and suspensions
field_checks                    what charge relaxation and periodic fields do not allow in other tables
scene_files                     reads and writes scene files, also built-in ones
parameters                      the physical numbers of a scene file by name
uses                            the keys that each use of a scene file supports
sweep_tables, sweep_files       keys, reading and cases of sweep files
template                        the scene file that `jaxves init` writes
scenes                          the built-in scenes
"""

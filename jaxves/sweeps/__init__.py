"""Many cases of one scene.

case_summary    what a sweep keeps of one case
motions         the motion in shear of each case
batches         many cases in one compiled program
refinement      where a phase diagram needs more cases
processes       several processes, one sweep
sweeping        `sweep`: which cases are due, also after an interruption, and their results into the file
"""

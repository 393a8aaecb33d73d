"""How a run ended: an integer code in compiled code, and a word with one line of advice outside.

Codes are ordered by severity, so that several findings can be combined with the maximum. Two codes do not belong to
this order: `invalid` is found at the start only, and `inaccurate` is found after a run has reached its end.
"""

COMPLETE = 0
STEADY = 1
CLASS_REACHED = 2
INTERRUPTED = 3
UNRESOLVED = 4
DRIFT = 5
SOLVE_FAILED = 6
CROWDED = 7
SELF_CONTACT = 8
COLLISION = 9
STEP_UNDERFLOW = 10
TOO_MANY_STEPS = 11
NOT_FINITE = 12
INVALID = 13
INACCURATE = 14
RUNNING = -1

WORDS = {
    RUNNING: "running",
    COMPLETE: "complete",
    STEADY: "steady",
    CLASS_REACHED: "class reached",
    INTERRUPTED: "interrupted",
    UNRESOLVED: "unresolved",
    DRIFT: "drift",
    SOLVE_FAILED: "solve failed",
    CROWDED: "crowded",
    SELF_CONTACT: "self-contact",
    COLLISION: "collision",
    STEP_UNDERFLOW: "step underflow",
    TOO_MANY_STEPS: "too many steps",
    NOT_FINITE: "not finite",
    INVALID: "invalid",
    INACCURATE: "inaccurate",
}

ADVICE = {
    "running": "The process that wrote this file has ended. All saved times are kept: "
    "continue with resume=True (--resume).",
    "complete": "",
    "steady": "The stop condition was met: no shape changes faster than the limit.",
    "class reached": "The stop condition was met.",
    "interrupted": "All saved times are kept: continue with resume=True (--resume).",
    "unresolved": "The nodes no longer resolve the shape, the potential or a film between membranes: use more nodes, "
    "and for a film a lower tolerance.",
    "drift": "Area or perimeter are not conserved: use a lower tolerance or a smaller time step. "
    "For a circle among other vesicles, use reduced_area = 0.999.",
    "solve failed": "A linear system was not solved accurately: use more nodes or the dense solver.",
    "crowded": "More vesicles are near one another than the matrix-free solver has room for: raise `neighbours`.",
    "self-contact": "Two parts of one membrane have crossed: use more nodes and a lower tolerance.",
    "collision": "Two membranes have crossed: use more nodes and a lower tolerance.",
    "step underflow": "The time step fell below its limit, so the tolerance cannot be met: "
    "use more nodes or a larger tolerance.",
    "too many steps": "The limit on the number of steps was reached: "
    "use a larger tolerance, or continue with resume=True (--resume).",
    "not finite": "A value overflowed: use a smaller step, or `tolerance` instead of `time_step`.",
    "inaccurate": "The run reached its end, but its error estimates leave less than one correct digit: use more nodes "
    "and a lower tolerance. The certificate names the largest error.",
    "invalid": "A number of the scene is out of its bounds, or a starting curve is clockwise or has unevenly spaced "
    "nodes: call make_scene with values that are not traced to see which.",
}

SUCCESS = frozenset({"complete", "steady", "class reached"})

"""How a run ended: one integer inside compiled code, one word and one line of advice outside.

Codes are ordered by severity, so that several findings combine by maximum. What is judged of the start alone, or of
a whole run that reached its end, stands outside of this order: `invalid` and `inaccurate`.
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
    "running": "Its process has ended; everything up to here is kept; continue it with --resume.",
    "complete": "",
    "steady": "The stop condition was met: nothing moves faster than the limit.",
    "class reached": "The stop condition was met.",
    "interrupted": "Everything up to here is kept; continue with --resume.",
    "unresolved": "The nodes no longer resolve the shape, the potential or a film between membranes: use more nodes, "
    "and for a film a lower tolerance.",
    "drift": "Area or perimeter left their values: lower the tolerance or the time step; "
    "a circle among others cannot be held in shape: take reduced_area = 0.999.",
    "solve failed": "A linear system was not solved to round-off: use more nodes or the dense solver.",
    "crowded": "More vesicles are near one another than the matrix-free solver has room for: raise `neighbours`.",
    "self-contact": "Two parts of one membrane have crossed: use more nodes and a lower tolerance.",
    "collision": "Two membranes have crossed: use more nodes and a lower tolerance.",
    "step underflow": "The step fell below its limit: the tolerance is out of reach here; use more nodes or loosen it.",
    "too many steps": "The step limit was reached: loosen the tolerance or split the run with --resume.",
    "not finite": "A value overflowed: use a smaller step, or `tolerance` instead of `time_step`.",
    "inaccurate": "The run reached its end, but its own estimates leave less than one correct digit: use more nodes or "
    'nodes = "auto", and a lower tolerance; the certificate names the weakest link.',
    "invalid": "A number of the scene is out of its bounds, or a starting curve is clockwise or has nodes that are not "
    "equispaced; make_scene and scene files say which when the values are not traced.",
}

SUCCESS = frozenset({"complete", "steady", "class reached"})

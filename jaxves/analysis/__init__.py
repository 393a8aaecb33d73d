"""Derivatives, and what is found with them.

steady          steady shapes by Newton's method
sensitivity     first and second derivatives of what a run gives
differences, gradcheck  derivatives against finite differences
boxes           numbers in bounds as numbers without
observations    what was observed, and the model that shows the same
search          the search for the best numbers from one start, by a trust region
descent         the same search by gradient descent
kept_starts     starts of a fit that are done, in a file
fit             numbers from observations: all starts, and what their best end is worth
critical_field  the field beyond which a vesicle does not stay prolate
"""

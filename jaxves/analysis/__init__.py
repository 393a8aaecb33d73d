"""Derivatives, and what is found with them.

steady          steady shapes by Newton's method
sensitivity     first and second derivatives of what a run gives
differences, gradcheck  derivatives against finite differences
boxes           numbers in bounds as numbers without
fit             numbers from observations
critical_field  the field beyond which a vesicle does not stay prolate
"""

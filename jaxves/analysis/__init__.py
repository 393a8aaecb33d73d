"""Derivatives and their uses: steady shapes, sensitivities, fits, critical values.

steady          steady shapes by Newton's method
disturbances    small disturbances of a steady shape: linearised motion, what is kept, symmetries
stability       growth rates of small disturbances of a steady shape, with derivatives
sensitivity     first and second derivatives of diagnostics
half_turns      averages over half-turns of a tumbling vesicle, with derivatives
differences, gradcheck  comparison of derivatives with finite differences
boxes           coordinates for numbers with bounds
film_gauge      outlines of a film as observations
observations    observed quantities, and the model that computes them
search          fit from one start by a trust region
descent         fit from one start by gradient descent
kept_starts     the file of finished starts of a fit
intervals       intervals of fitted numbers, and combinations that are not determined
fit             numbers from observations, with confidence intervals
control         a run as a function of the values of the field, and the cost of missing a goal
line_search     one step of the search for such values
steering        the field in time with which a run ends as wanted
critical        what searches for critical numbers share
critical_field  the field above which a vesicle does not stay prolate
continuation    steady shapes followed along a number of their scene, also through folds
fold            the value of a number where steady shapes end, as treading at a viscosity ratio
"""

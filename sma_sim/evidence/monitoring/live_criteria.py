"""The numbers of the live check: what is known of changes beforehand, how the past is kept, what a look may cost."""

from __future__ import annotations

import math

from sma_sim.evidence.estimation.problem import DEFAULT_STEP

# What is known beforehand. These decide.
MEAN_TIME = 86_400.0
"""[s] between two changes of a robot, beforehand: one a day. A factor of ten is 2.3 nat of all causes alike."""
AMOUNT = 2.0
"""Standard deviation of an amount, in steps of its cause: a step is a third of what is realistic."""
MAX_AMOUNT = 4.0 * AMOUNT
"""[steps] An amount is between 0 and four standard deviations: beyond lies another cause."""
ONSET_STD = 10.0
"""[s] of an instant that the data do not tell: what changes slowly shows late."""
EARLIER = 2.0 * ONSET_STD
"""[s] before its detection from which a change is looked for; twice as long before where it would begin just then."""

# How the past is kept
BIN = 0.25
"""[s] over which measurements are averaged: short beside wires, long beside a sampling interval."""
SPAN = 300.0
"""[s] of the past that is looked at, in which a change may begin: it bounds what a look simulates."""
CHECKPOINT = 10.0
"""[s] between instants at which the state of the model is kept: a look simulates no more than that in vain."""
STEP = 1.0
"""[s] to which the instant is found at which residuals stop being white; the fit of a cause then moves it."""
SHORTEST = 20
"""Bins that say something: fewer cannot tell a smooth function from noise."""
CHANGE = math.log(CHECKPOINT / MEAN_TIME)
"""Log prior probability of a change between two looks."""

# Where a cause is looked for. Wires have hysteresis: a small change may show nothing of a large one.
PROBED = (0.5, 1.5, 4.0)
"""Amounts [steps] at which a cause is looked at before it is fitted: within, at and beyond one standard deviation."""
UNSEEN = 0.01
"""Sum of the squares of a response over noise below which a cause shows nothing: noise moves its score by 0.1 nat then."""

# What a look may cost: all causes are probed, the best of them fitted.
SKETCHED, SKETCHES = 10, 4
"""Causes that are simulated at their amounts, and the steps of their fits."""
FEW_INSTANTS, INSTANTS = 5, 25
"""From which a cause may start: of all causes, and of those that are simulated; the cost has a valley between commands."""
REFINED, REFINEMENTS = 5, 12
"""Causes that are fitted until nothing improves, and the most steps that this takes."""
CALIBRATIONS = 3
"""Times that the parameters of the robot are estimated anew at a look: each starts where the one before has ended."""

# Fits
MOVED = DEFAULT_STEP
"""Differences of derivatives in amounts [steps], as in other fits; those in an instant are a BIN."""
PARAMETER_STEP = 0.05
"""Of its standard deviation, by which a parameter is moved for derivatives; estimates that change by less have settled."""
DECREASE = 0.05
"""Of the log posterior, below which a fit has ended: verdicts are read to a tenth of a nat."""
DAMPING, MAX_DAMPING, DAMPED = 1e-2, 1e6, 5.0
"""Of a step at first, at most (it moves nothing then), and the factor of a change."""

# The command that decides between two causes: simple ones, the shortest first
DURATIONS = (3.0, 6.0, 12.0, 25.0, 50.0)
"""[s] of heating, after which the wires cool for as long."""
PARTS = (1.0, 0.5)
"""Of the most power: half of it transforms a wire in part."""

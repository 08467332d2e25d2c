"""Diagnosis of a log of a loop that swings: the cause, the evidence, a remedy that was simulated.

`oscillation` finds the swing and `law` the force; `plant` says what may have made the log, `structure` and `fit` fit
it; `causes` judges, `words` names the causes, and `remedies` simulates what helps.
"""

"""From logs to a device file.

`read` and `log`: files, columns and records. `terms`: parameters and rungs. `regression`: the first guess.
`linear_step` and `predictor`: the model in a sample, and its prediction. `fit`: one structure, its evidence and
intervals. `response` and `ladder`: which structure. `identify` and `device`: the answer. `excitation`: plans
of a safe motion, with the `signal` in integers.
"""

"""Fit the walls VE4, VE5 and VE6 to the paper's column without coupling.

python tests/benchmarks/calibrate_walls.py [PEOPLE]

prints the stiffness at which the training people of set A are stable without coupling in the share that the paper's
count suggests; problems/ve4.toml to ve6.toml hold the values to two digits. Overwrites no file.
"""

from script_arguments import script_arguments
from studies.table1.calibration import calibrated_stiffness, expected_share
from studies.table1.paper import PAPER

import avc_casadi as avc

FITTED = ("VE4", "VE5", "VE6")


def main(people):
    device = avc.load_problem("ve7")
    for wall in FITTED:
        count = PAPER[wall].stable_without_coupling
        stiffness = calibrated_stiffness(device, count, people=people)
        in_use = avc.load_problem(wall.lower()).environment.stiffness_n_per_m
        print(f"{wall}: {count} of 10, share {expected_share(count):.3f}: {stiffness:.4g} N/m; in use {in_use:.4g} N/m")


if __name__ == "__main__":
    main(script_arguments(__doc__, people=500).people)

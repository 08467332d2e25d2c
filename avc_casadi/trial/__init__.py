"""Trials with many simulated people: who they are, what they do, and whether their hands come to rest."""

from avc_casadi.trial._binomial import CONFIDENCE as CONFIDENCE
from avc_casadi.trial._binomial import exact_interval as exact_interval
from avc_casadi.trial._coupling_trial import CouplingTrial as CouplingTrial
from avc_casadi.trial._coupling_trial import try_coupling as try_coupling
from avc_casadi.trial._coupling_trial import try_on_devices as try_on_devices
from avc_casadi.trial._matching import WEBER as WEBER
from avc_casadi.trial._matching import WEBER_SWEEP as WEBER_SWEEP
from avc_casadi.trial._matching import choose as choose
from avc_casadi.trial._matching import distance as distance
from avc_casadi.trial._matching import reference_traces as reference_traces
from avc_casadi.trial._subjects import Population as Population
from avc_casadi.trial._subjects import corner_subjects as corner_subjects
from avc_casadi.trial._subjects import draw_hands as draw_hands
from avc_casadi.trial._subjects import draw_subjects as draw_subjects
from avc_casadi.trial._subjects import people_of as people_of
from avc_casadi.trial._trial import MOTIONS as MOTIONS
from avc_casadi.trial._trial import PEOPLE_AT_ONCE as PEOPLE_AT_ONCE
from avc_casadi.trial._trial import Conditions as Conditions
from avc_casadi.trial._trial import Traces as Traces
from avc_casadi.trial._trial import all_motions as all_motions
from avc_casadi.trial._trial import judged as judged
from avc_casadi.trial._trial import traces as traces
from avc_casadi.trial._vibration import QUIET as QUIET
from avc_casadi.trial._vibration import felt_vibration as felt_vibration
from avc_casadi.trial._vibration import threshold_m as threshold_m

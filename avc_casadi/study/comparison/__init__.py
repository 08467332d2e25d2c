"""Comparison of the design methods, frequency by frequency."""

from avc_casadi.study.comparison._comparison import Comparison as Comparison
from avc_casadi.study.comparison._comparison import compare as compare
from avc_casadi.study.comparison._comparison import with_delivered as with_delivered
from avc_casadi.study.comparison._document import comparison_document as comparison_document
from avc_casadi.study.comparison._hand_tuned import HandTuned as HandTuned
from avc_casadi.study.comparison._hand_tuned import judge_hand_tuned as judge_hand_tuned
from avc_casadi.study.comparison._injection import DampingInjection as DampingInjection
from avc_casadi.study.comparison._injection import damping_injection as damping_injection
from avc_casadi.study.comparison._judged import Judged as Judged
from avc_casadi.study.comparison._judged import judge_gains as judge_gains
from avc_casadi.study.comparison._safety import Safety as Safety
from avc_casadi.study.comparison._safety import safer as safer
from avc_casadi.study.comparison._safety import safety_reason as safety_reason
from avc_casadi.study.comparison._tables import ComparisonTables as ComparisonTables
from avc_casadi.study.comparison._tables import comparison_tables as comparison_tables
from avc_casadi.study.comparison._verdict import Verdict as Verdict
from avc_casadi.study.comparison._verdict import judge as judge

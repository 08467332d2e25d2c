"""What the estimators of the interaction frequency are worth."""

from avc_casadi.study.estimators._estimator_study import EstimatorRow as EstimatorRow
from avc_casadi.study.estimators._estimator_study import EstimatorTraces as EstimatorTraces
from avc_casadi.study.estimators._estimator_study import cramer_rao_hz as cramer_rao_hz
from avc_casadi.study.estimators._estimator_study import study_estimators as study_estimators
from avc_casadi.study.estimators._estimator_study import trace_estimators as trace_estimators

"""Proofs about the loop over whole sets of hands, in arithmetic that encloses every rounding."""

from avc_casadi.proof._frozen_loop import FrozenGains as FrozenGains
from avc_casadi.proof._hands_proof import BUDGET as BUDGET
from avc_casadi.proof._hands_proof import HandsProof as HandsProof
from avc_casadi.proof._hands_proof import Outcome as Outcome
from avc_casadi.proof._hands_proof import Piece as Piece
from avc_casadi.proof._hands_proof import prove_hands as prove_hands
from avc_casadi.proof._interval import ComplexInterval as ComplexInterval
from avc_casadi.proof._interval import Interval as Interval
from avc_casadi.proof._interval import cosine as cosine
from avc_casadi.proof._interval import matrix_product as matrix_product
from avc_casadi.proof._interval import sine as sine
from avc_casadi.proof._zero_exclusion import Cells as Cells

"""A local page to turn knobs on: what a device, a wall and a hand make of a coupling, answered while a slider moves."""

from avc_casadi.explore._answers import PARTS as PARTS
from avc_casadi.explore._explorer import Explorer as Explorer
from avc_casadi.explore._server import ExploreServer as ExploreServer
from avc_casadi.explore._settings import problem_of_settings as problem_of_settings

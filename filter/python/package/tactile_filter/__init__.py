"""Which peg fits a hole, and where the hole is, found by touch."""

from ._native import *  # noqa: F403
from ._native import __version__ as __version__

"""The names that a script imports for a session with an axis: the class Session, its errors, and
functions that are often used with it. See forceaxis.axis.session."""

from forceaxis.axis.axis import MODES, trigger_on
from forceaxis.axis.session import Session, seconds
from forceaxis.bus.client import NoAnswer, Refused

__all__ = ["MODES", "NoAnswer", "Refused", "Session", "seconds", "trigger_on"]

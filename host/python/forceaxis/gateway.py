"""The class Session of forceaxis.axis.session, under the module name that scripts import."""

from forceaxis.axis.axis import MODES, trigger_on
from forceaxis.axis.session import Session, seconds
from forceaxis.bus.client import NoAnswer, Refused

__all__ = ["MODES", "NoAnswer", "Refused", "Session", "seconds", "trigger_on"]

"""`forceaxis.bus.gateway` by the name that scripts import: a session at an axis."""

from forceaxis.bus.gateway import MODES, NoAnswer, Refused, Session, seconds, trigger_on

__all__ = ["MODES", "NoAnswer", "Refused", "Session", "seconds", "trigger_on"]

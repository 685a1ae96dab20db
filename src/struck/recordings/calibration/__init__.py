"""Fitted modes against computed ones: which is which, and what the body is made of."""

from struck.recordings.calibration.calibration import Calibration, calibrated, inferable
from struck.recordings.calibration.correcting import corrected

__all__ = ["Calibration", "calibrated", "corrected", "inferable"]

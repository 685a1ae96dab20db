"""Fitted modes against computed ones: which is which, and what the body is made of."""

from struck.recordings.calibration.calibration import Calibration, calibrated, corrected, inferable

__all__ = ["Calibration", "calibrated", "corrected", "inferable"]

"""Repair of surfaces: `body` decides, the other rooms mend, tell bodies apart, or rebuild."""

from struck.solids.repair.body import Repair, repaired

__all__ = ["Repair", "repaired"]

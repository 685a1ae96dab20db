"""Repair of surfaces: `struck.solids.surface.repair` decides, the rooms here mend or rebuild."""

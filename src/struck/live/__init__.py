"""From samples to the loudspeaker, while they are being made."""

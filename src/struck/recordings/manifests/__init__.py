"""Which recording was struck where, and heard from where."""

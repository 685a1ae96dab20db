"""Processes that struck starts, and the orderly end of the present one."""

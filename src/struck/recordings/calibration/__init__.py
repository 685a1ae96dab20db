"""Fitted modes against computed ones: which is which, and what the body is made of."""

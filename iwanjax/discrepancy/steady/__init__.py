"""Steady cycles: curves of modes and loops of joints, and what they say is missing."""

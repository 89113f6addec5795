"""Steady motion: a hypothesis fitted to curves of modes, or to loops of a joint."""

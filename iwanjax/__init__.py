"""Differentiable model updating for structures with bolted joints."""

__version__ = "0.1.0"

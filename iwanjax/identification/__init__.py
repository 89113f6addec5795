"""Identification: a hypothesis fitted to recordings by its prediction errors (Ljung, 1999).

An observer predicts each sample from those before; what it did not predict is fitted, with a time
constant that grows from two cycles to the free run. Which hypotheses are worth it, and what they
say, is decided in :mod:`iwanjax.discrepancy`.
"""

"""Time histories: from recordings to what they say is missing.

The modules, in the order that data take: :mod:`conditioning`, :mod:`predictor`, :mod:`innovations`,
:mod:`observer`, :mod:`kernels`; :mod:`problem`, :mod:`hypotheses`, :mod:`linearise`,
:mod:`multistart`; :mod:`score_test`, :mod:`place_test`, :mod:`selection`, :mod:`ranking`;
:mod:`validation`.
"""

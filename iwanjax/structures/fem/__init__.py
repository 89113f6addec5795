"""Finite element models of the beams that the thesis studies (extra ``fem``)."""

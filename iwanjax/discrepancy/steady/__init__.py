"""Steady cycles: curves of modes and loops of joints, and what they say is missing.

``cycle`` is what an effect does over a cycle; ``curves``, ``modes`` and ``loops`` hold a model with
an effect against what was measured, each by problems of one interface; ``fit`` has that interface
and the one fit type; ``runs`` the predictions beside the measurements; ``verdict`` tries effects in
time, ranks them and concludes; ``diagnose_joint`` and ``diagnose_modes`` are the public functions.
"""

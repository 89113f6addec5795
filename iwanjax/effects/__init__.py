"""Effects: what may be missing from a model. A law at a place, or a fault of a channel or joint."""

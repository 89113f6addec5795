"""Settings: every tuned number of a diagnosis, with unit, meaning and source, by stage."""

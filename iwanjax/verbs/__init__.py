"""What the command line's verbs do with a study: compute, and write numbers and pictures."""

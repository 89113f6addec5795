"""The command line's verbs: they call a study and write what it returns."""

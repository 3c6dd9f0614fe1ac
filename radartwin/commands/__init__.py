"""The commands (verbs) of the command line: their arguments, the functions that run them, and examples for the help texts."""

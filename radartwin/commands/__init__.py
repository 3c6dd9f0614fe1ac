"""The verbs of the command line: arguments, bodies, and examples for the help."""

"""Write tables, figures and the report from stored results of experiments. This package computes no results itself."""

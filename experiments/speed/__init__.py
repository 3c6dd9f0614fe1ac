"""Run time against error for every method, and the benchmarks."""

"""Run time against error of every simulation method, and benchmarks of single program parts."""

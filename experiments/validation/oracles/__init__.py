"""Independent oracles of the tracer: closed forms, series and quadratures that share no code with radartwin.simulation."""

"""Independent references for the tracer: closed forms, series and quadratures that share no code with radartwin.simulation."""
